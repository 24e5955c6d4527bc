//! Areas and moments of the plant's response.
//!
//! Equation: with s the response to a unit step and K its end, A₀ = ∫(K − s) dt = K·T_ar, T_ar the average residence time, and A₁ = ∫₀^T_ar s dt.
//! K·e^(−Ls)/(1 + sT) has T_ar = L + T and A₁ = KT/e, so L = T_ar − e·A₁/K; K·e^(−Ls)/(1 + sT)² has T_ar = L + 2T and A₁ = 4KT/e², so L = T_ar − (e²/2)·A₁/K.
//! Which of the two a plant is nearer to, these numbers do not say: an interval reaches from the one reading to the other.
//!
//! A step response that is sampled behind a hold is taken to be straight between its samples, so that L is that of continuous time: the sample of the hold is not in it,
//! and one sample less than the relative degree is taken off.
//!
//! Source: Åström and Hägglund (1995), "PID Controllers: Theory, Design, and Tuning", 2nd ed., section 2.4; Björklund (2003), LiU-TEK-LIC-2003:60, class 3.

pub(super) mod area1;
pub(super) mod estimated;
mod reading;
