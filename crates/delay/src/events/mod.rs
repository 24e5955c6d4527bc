//! The delay between two event sequences, sensor to sensor; an offset pairs each event at one place with the same event at the other.
//!
//! t(i) are the times of the events at the first place, T(i) at the second. Differences are Δ(i + k, i) = T(i + k) − t(i), ΔT(i + k) = T(i + k) − T(i + k − 1).
//! Likewise Δt(i) = t(i) − t(i − 1). Each criterion rates an offset k as a pairing of the events; the delay is the mean of Δ at the best offset.
//!
//! All criteria share the same acceptance test. The paired intervals must be correlated significantly. Events are then paired by time: each with its neighbour
//! at the typical delay of the half whose intervals agree most. An event missed by one sensor then costs one pair instead of all later ones.
//!
//! Source: Kekäläinen (2019), Acta IMEKO 8(1), 77-86, doi:10.21014/acta_imeko.v8i1.540. The paper compares offsets by the criterion alone, without uncertainty
//! or missed events.

pub(super) mod criteria;
pub(crate) mod jitter;
pub(crate) mod offsets;
pub(crate) mod times;
