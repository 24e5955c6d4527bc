//! Output-error models: orders, initial state, and fits.

use deadtime_signal::fit::Stopped;

/// The assumption on the model's state when a record starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Initial {
    /// At rest.
    #[default]
    Zero,
    /// Unknown: nf more parameters per record, estimated jointly.
    Estimated,
}

/// Orders and initial state of an output-error model.
///
/// The predictor is kept stable. B (and the initial state) enter linearly and are eliminated (variable projection, Kaufman's Jacobian), so the search is over F
/// alone. Starts for each delay: a fixed table of pole positions, Steiglitz-McBride, and the neighbouring delays' solutions, upwards and downwards.
///
/// Source: Ljung (1999), "System Identification", 2nd ed., sections 4.2 and 10.2. Golub and Pereyra (2003), doi:10.1088/0266-5611/19/2/201. Steiglitz and
/// McBride (1965), doi:10.1109/TAC.1965.1098181.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutputError {
    /// Numerator coefficients.
    pub nb: usize,
    /// Poles.
    pub nf: usize,
    /// The state at the start of a record.
    pub initial: Initial,
}

/// An output-error model of one delay.
#[derive(Debug, Clone, PartialEq)]
pub struct OeFit {
    /// Σ e²/samples.
    pub loss: f64,
    /// b₀ … b_nb−1.
    pub b: Vec<f64>,
    /// f₁ … f_nf, of F = 1 + f₁q⁻¹ + …
    pub f: Vec<f64>,
    /// Why the search stopped, at the best of its starts.
    pub stopped: Stopped,
}
