//! Every threshold that can change a verdict: what it means, its unit, where it comes from.
//!
//! Three kinds of origin. *Formula*: it follows from what stands beside it. *Null*: what chance alone reaches where nothing acts. *Chosen*: set by hand on
//! withheld cases with known causes; no theory gives it, and how much each matters has not been measured. Formulas were found beside values that stood already.

/// The thresholds; [`Default`] gives those that every verdict of the program rests on.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Criteria {
    /// By so much the best of a whole catalogue must beat no effect, and the best second effect a single one; twice a log-likelihood. Null: the best of 50 to
    /// 100 rivals reaches 10 to 25 on noise alone.
    pub selection_penalty: f64,
    /// Hypotheses that differ by less are as good as each other; twice a log-likelihood. Formula: a likelihood ratio of 20, as between a 95 % and a certain
    /// statement (2 ln 20 = 6.0).
    pub equals: f64,
    /// No simulator is exact: this part of the energy that an effect explains (1.4 % of its amplitude) is within what a model is off anyway; 1. Chosen.
    pub inexact: f64,
    /// A second effect must promise to take this part of what the first one leaves; 1. Chosen.
    pub promising: f64,
    /// A residual this many times its floor has something left in it; 1. Chosen.
    pub above_floor: f64,
    /// The same where no effect helps at all: a gap worth the name is well above the noise; 1. Chosen.
    pub above_floor_alone: f64,
    /// A first effect that lowers the rms of no output by this factor is within the noise; 1. Chosen.
    pub first_matters: f64,
    /// The same of a second effect, on the training logs and the held-out data together; 1. Chosen.
    pub second_matters: f64,
    /// The same once more for every parameter beyond a second effect's first: what can take many shapes takes that of a simulator's own errors, too; 1. Chosen.
    pub flexible: f64,
    /// A second effect that lowers the rms by this factor is no simulator's own error, however little is known of its parameters; 1. Chosen.
    pub clear: f64,
    /// The share of the explainable that one effect must explain; 1. Chosen.
    pub one_explains: f64,
    /// The share that two must explain; 1. Chosen.
    pub two_explain: f64,
    /// The share of the explainable that one effect must explain on held-out data: less, and it describes the training logs and no cause; 1. Chosen.
    pub one_generalises: f64,
    /// The same of two; 1. Chosen.
    pub two_generalise: f64,
    /// Noise of a sensor forgets within so many samples; what remembers longer is a gap. Chosen: an assumption about sensors, not a result.
    pub slowest_noise: f64,
    /// A window in which calm is looked for holds at least so many times the noise's memory; 1. Chosen.
    pub window_memories: f64,
    /// Past outputs must lower the variance of what its own past leaves of a command by this part before that counts as fed back; 1. Chosen.
    pub fed_back: f64,
    /// Correlation of command and residual in the same sample, in standard deviations of chance. Null: 5 standard deviations come by chance once in a million.
    pub correlated: f64,
    /// A lost command counts for the probability of losses where the two possible pasts differ by so many standard deviations of the noise. Formula: a
    /// decision between them errs with the probability Φ(−2) = 2 %.
    pub decided: f64,
    /// So many decisions at least give a probability of losses. Chosen.
    pub decisions: f64,
    /// An interval is doubled while less than this is lost at its end; twice a log-likelihood. Formula: a smooth cost loses 3.84 at the end of a 95 %
    /// interval, and a quarter of that at the end of one that is half as wide.
    pub unnoticed: f64,
    /// The prior of one state's start is taken this much wider, and as much tighter, when the lead is looked at again; 1. Chosen.
    pub prior_factor: f64,
    /// Where a delay that explains much stands at the longest that was looked for, so many times longer ones are looked for, once; 1. Chosen.
    pub longer: f64,
    /// A delay explains much where it gains this part of what the best effect gains; 1. Chosen.
    pub much: f64,
}

impl Default for Criteria {
    fn default() -> Self {
        Self {
            selection_penalty: 30.0,
            equals: 6.0,
            inexact: 2e-4,
            promising: 0.05,
            above_floor: 1.5,
            above_floor_alone: 1.75,
            first_matters: 1.3,
            second_matters: 1.25,
            flexible: 1.1,
            clear: 2.0,
            one_explains: 0.93,
            two_explain: 0.97,
            one_generalises: 0.5,
            two_generalise: 0.75,
            slowest_noise: 60.0,
            window_memories: 4.0,
            fed_back: 0.05,
            correlated: 5.0,
            decided: 4.0,
            decisions: 5.0,
            unnoticed: 1.0,
            prior_factor: 10.0,
            longer: 3.0,
            much: 0.25,
        }
    }
}
