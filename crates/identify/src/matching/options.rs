//! The options of a match.

use super::norms::NORMS;

/// The options of a match.
#[derive(Debug, Clone, PartialEq)]
pub struct Matching {
    /// Names of the parameters to find. `all`: every parameter not marked as known, and all dead times; `delay:INPUT`: the dead time of an input.
    pub free: Vec<String>,
    /// The norm's name in [`NORMS`]; default `wls`.
    pub norm: String,
    /// From and to, rad/s. Default: the data's range up to just below the Nyquist frequency, or a decade beyond the poles.
    pub band: Option<[f64; 2]>,
    /// Number of starts, the file's values first; default 8.
    pub starts: usize,
    /// Prior standard deviation of the file's values, as a share of each, for `wls` and `h2`. Default: that of largest evidence, from 0.1 to 10; ∞: no prior.
    /// Dead times have no prior.
    pub prior: Option<f64>,
    /// The unit of a channel in norms of gains, by name; default 1 of its own unit.
    pub units: Vec<(String, f64)>,
    /// States and inputs of the linearisation, by name; default: the file's initial states and the identified model's operating inputs.
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
