//! What is matched, and how.

use super::norms::NORMS;

/// What is matched, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Matching {
    /// Parameters to find, by name; `all`: every parameter that the file does not call known, and all dead times; `delay:INPUT`: the dead time of an input.
    pub free: Vec<String>,
    /// The norm's name in [`NORMS`]; default `wls`.
    pub norm: String,
    /// From and to, rad/s; default: what the data show up to just below the Nyquist frequency, or a decade beyond the poles.
    pub band: Option<[f64; 2]>,
    /// Starts, the file's values first; default 8.
    pub starts: usize,
    /// Prior standard deviation of the file's values, as a share of each, by `wls` and `h2`; default: that of greatest evidence, from 0.1
    /// to 10; ∞: no prior. Dead times are not held.
    pub prior: Option<f64>,
    /// What counts as one of a channel in norms of gains, by name; default 1 of its unit.
    pub units: Vec<(String, f64)>,
    /// States and inputs where the equations are linearised, by name; default: the file's initial states and the identified model's operating inputs.
    pub at: Vec<(String, f64)>,
}

impl Default for Matching {
    fn default() -> Self {
        Self {
            free: Vec::new(),
            norm: NORMS[0].name.to_owned(),
            band: None,
            starts: 8,
            prior: None,
            units: Vec::new(),
            at: Vec::new(),
        }
    }
}
