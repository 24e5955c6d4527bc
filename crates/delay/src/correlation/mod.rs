//! The lag at which input and output are most similar: cross-correlation, unweighted or weighted over frequency.
//!
//! Equation: τ̂ = argmax |R(τ)|, R(τ) = Σ over ω of ψ(ω)·Ĝuy(ω)·exp(iωτ); Knapp and Carter (1976), eq. 7, ψ from their table I.
//!
//! 1. Every whole lag of the window by correlation of the whole records. ψ comes from spectra averaged over segments. First y is moved back by the best lag so
//!    far: a delay long compared with a segment would hide the coherence. ψ is applied as a filter of the lags.
//! 2. Below one sample: the maximum of the exact band-limited R(τ) by Newton's method, from the averaged cross-spectrum of the aligned records.
//! 3. Uncertainty: the larger of two variances of R′(τ̂). The first follows from the noise at the estimated coherence (the two-sensor bound for the optimal ψ),
//!    the second from the cross-spectrum's phases. Where the delays at single frequencies differ significantly, the plant has a lag of its own, and their
//!    spread is added. Other peaks that noise may have lowered below the highest widen the interval, or make the result `flat`.

pub(crate) mod generalised;
pub(crate) mod weights;
