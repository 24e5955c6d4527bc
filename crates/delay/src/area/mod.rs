//! Areas and moments of the plant's response.
//!
//! Equation: A₀ = ∫(K − s) dt = K·T_ar and A₁ = ∫₀^T_ar s dt. Here s is the unit-step response, K its final value, T_ar the average residence time.
//! K·e^(−Ls)/(1 + sT) has T_ar = L + T and A₁ = KT/e, so L = T_ar − e·A₁/K. K·e^(−Ls)/(1 + sT)² has T_ar = L + 2T and A₁ = 4KT/e², so L = T_ar − (e²/2)·A₁/K.
//! The areas do not determine which of the two fits better, so the interval spans both readings.
//!
//! The sampled step response behind a hold is interpolated linearly, so L is the continuous-time delay. L excludes the sample of the hold; the relative degree
//! minus one sample is subtracted.
//!
//! Source: Åström and Hägglund (1995), "PID Controllers: Theory, Design, and Tuning", 2nd ed., section 2.4; Björklund (2003), LiU-TEK-LIC-2003:60, class 3.

pub(super) mod area1;
pub(super) mod estimated;
mod reading;
