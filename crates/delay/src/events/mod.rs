//! The delay between two sequences of event times, sensor to sensor: which event at one place is which at the other.
//!
//! t(i) are the times of the events at the first place, T(i) at the second; Δ(i + k, i) = T(i + k) − t(i), ΔT(i + k) = T(i + k) − T(i + k − 1),
//! Δt(i) = t(i) − t(i − 1). Each criterion says how well an offset k pairs the events; the delay is the mean of Δ at the best one.
//!
//! Whatever the criterion, the answer is judged alike. The intervals that it pairs must be correlated significantly. Events are then paired by time, each with its
//! neighbour about the typical delay of the pairs whose intervals agree most. An event that one sensor missed then costs one pair and not all that follow.
//!
//! Source: Kekäläinen (2019), Acta IMEKO 8(1), 77-86, doi:10.21014/acta_imeko.v8i1.540. It compares offsets by the value of a criterion alone and speaks neither of
//! uncertainty nor of missed events.

pub(super) mod criteria;
pub(crate) mod jitter;
pub(crate) mod offsets;
pub(crate) mod times;
