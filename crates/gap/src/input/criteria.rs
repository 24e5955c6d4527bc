//! Every threshold that can change a verdict: its meaning, its unit, its origin.
//!
//! Three kinds of origin. *Formula*: the stated formula gives the value. *Null*: the value that chance alone reaches without any effect. *Chosen*: set by hand on
//! withheld cases with known causes. No theory gives a chosen value, and the sensitivity of the results to it is not measured.

/// The thresholds; [`Default`] gives those of every verdict of the program.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Criteria {
    /// The margin by which the best of a catalogue must beat no effect, and the best second effect a single one; twice a log-likelihood. Null: the best of 50
    /// to 100 hypotheses reaches 10 to 25 on noise alone. Under known noise, a hypothesis of k parameters gains χ² of k degrees of freedom by chance. The best
    /// of N then exceeds this value with at most N times the tail probability (Bonferroni). This is 300 hypotheses of three parameters in 0.04 % of logs. A
    /// value of 20 would give 5 %. The margin above 20 is for noise whose colour is estimated.
    pub selection_penalty: f64,
    /// Hypotheses that differ by less are as good as each other; twice a log-likelihood. Formula: a likelihood ratio of 20, as between a 95 % and a certain
    /// statement (2 ln 20 = 6.0).
    pub equals: f64,
    /// No simulator is exact. This part of the energy that an effect explains (1.4 % of its amplitude) is within the error of any model; 1. Chosen.
    pub inexact: f64,
    /// The required predicted reduction by a second effect, as a part of the first one's residual; 1. Chosen.
    pub promising: f64,
    /// A residual this many times its floor has something left in it; 1. Chosen.
    pub above_floor: f64,
    /// An answer with a residual above this many times its floor is not complete; 1. Chosen on the development bank.
    pub complete: f64,
    /// The same where no effect helps at all: a gap worth the name is well above the noise; 1. Chosen.
    pub above_floor_alone: f64,
    /// A first effect that lowers the rms of no output by this factor is within the noise; 1. Chosen.
    pub first_matters: f64,
    /// The same of a second effect, on the training logs and the held-out data together; 1. Chosen.
    pub second_matters: f64,
    /// The same factor for every parameter beyond a second effect's first. An effect of many shapes can imitate a simulator's own errors; 1. Chosen.
    pub flexible: f64,
    /// A second effect that lowers the rms by this factor is no simulator's own error, however little is known of its parameters; 1. Chosen.
    pub clear: f64,
    /// Every model's parameters are off by so much, relative, rms: a recalibration by less that lowers a small gap is no cause; 1. Formula: three standard
    /// deviations of the 1 % to which parameters are identified.
    pub usual_error: f64,
    /// From this probability of `unknown` on that is the verdict; 1. Formula: by its own definition the probability is 0.5 at the limit above the floor, and
    /// grows with every further multiple of the floor.
    pub unknown_from: f64,
    /// The share of the explainable that one effect must explain; 1. Chosen.
    pub one_explains: f64,
    /// The share that two must explain; 1. Chosen.
    pub two_explain: f64,
    /// For any explained part, a residual this many times its floor has a further cause; 1. Chosen: 96 % of its energy are no noise. No drawn case depends on
    /// it.
    pub further: f64,
    /// For a simulator that can only be called. A general form must explain this part of the gap's squared error beyond its special case, or lower the rms by
    /// `clear`; 1. Chosen.
    pub added_matters: f64,
    /// Where nothing is named: the predicted cost reduction, in selection penalties, of an effect that becomes detectable under another prior of the initial state; 1.
    /// Chosen: a change from just below one penalty to just above it changes no verdict.
    pub newly_visible: f64,
    /// The longest correlation length of sensor noise, samples; a residual with a longer one is a gap. Chosen: an assumption about sensors, not a result.
    pub slowest_noise: f64,
    /// The length of a window of the search for low-variance windows, in correlation lengths of the noise, at least; 1. Chosen.
    pub window_memories: f64,
    /// Windows per record, one search for low-variance windows for each number; changes of variance may be slow or fast. Chosen.
    pub windows: [usize; 3],
    /// Samples of the shortest window. Chosen: a variance of fewer has an error of half its size.
    pub shortest_window: usize,
    /// The least number of windows for a comparison. Chosen: two windows in the 25 % with the lowest variance.
    pub fewest_windows: usize,
    /// The part of the windows with the lowest variance; 1. Chosen.
    pub calm_part: f64,
    /// The probability below which low-variance windows are significant: that of stationary noise of the same colour; 1. Null: draws of that noise,
    /// made anew for every residual.
    pub calm_by_chance: f64,
    /// The longest autoregression of a residual, in samples; its order is Akaike's choice below this. Chosen.
    pub longest_autoregression: usize,
    /// The least number of samples for each of its coefficients; with fewer the noise counts as white. Chosen.
    pub samples_per_coefficient: f64,
    /// Past samples of all channels that predict a command, in the test for feedback. Chosen.
    pub feedback_past: usize,
    /// The uncertainty of commands in the fixed-gain predictor, as a part of their rms: small, so that the predictor absorbs no slow effect; 1. Chosen.
    pub uncertain: f64,
    /// The number of time constants of the predictor's slowest pole in a log; slower or unstable poles are mirrored about that circle. Chosen.
    pub forgets: f64,
    /// The innovations of a command are the part that its own past does not predict. A command is fed back if past outputs lower their variance by this share; 1. Chosen.
    pub fed_back: f64,
    /// Correlation of command and residual in the same sample, in standard deviations of chance. Null: 5 standard deviations come by chance once in a million.
    pub correlated: f64,
    /// A lost command is used for the probability of losses where the two possible pasts differ by this many standard deviations of the noise. Formula: a
    /// decision between them errs with the probability Φ(−2) = 2 %.
    pub decided: f64,
    /// The least number of decisions for a probability of losses. Chosen.
    pub decisions: f64,
    /// An interval is doubled while the loss at its end is below this; twice a log-likelihood. Formula: a smooth cost rises by 3.84 at the end of a 95 %
    /// interval. At the end of an interval of half the width the rise is 25 % of 3.84.
    pub unnoticed: f64,
    /// The factor by which the prior of one initial state is widened, and narrowed, for the test of the leading hypothesis; 1. Chosen.
    pub prior_factor: f64,
    /// The factor of longer delays, searched once, where a delay that explains much is at the limit of the search; 1. Chosen.
    pub longer: f64,
    /// Not unless the longer one is longer by this factor at least: near the limit that the logs set, nothing is gained; 1. Chosen.
    pub longer_at_least: f64,
    /// The model's own prediction, only moved in time by more than the longest delay, must explain this part of an output's variance; 1. Chosen.
    pub moved_explains: f64,
    /// Delays are then searched up to this many times that shift; 1. Chosen: the best of an interval must not be at its end.
    pub longer_than_moved: f64,
    /// The part of the gap below which a residual is no misfit: no simulator is exact; rms, 1. Chosen.
    pub inexact_gap: f64,
    /// A delay explains much where it gains this part of the best effect's gain, or reduces the squared error by this part; 1. Chosen.
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
            complete: 1.25,
            above_floor_alone: 1.75,
            first_matters: 1.3,
            second_matters: 1.25,
            flexible: 1.1,
            clear: 2.0,
            usual_error: 0.03,
            unknown_from: 0.5,
            one_explains: 0.93,
            two_explain: 0.97,
            further: 5.0,
            added_matters: 0.01,
            slowest_noise: 60.0,
            window_memories: 4.0,
            newly_visible: 2.0,
            windows: [20, 60, 180],
            shortest_window: 10,
            fewest_windows: 8,
            calm_part: 0.25,
            calm_by_chance: 0.01,
            longest_autoregression: 16,
            samples_per_coefficient: 10.0,
            feedback_past: 6,
            uncertain: 0.01,
            forgets: 10.0,
            fed_back: 0.05,
            correlated: 5.0,
            decided: 4.0,
            decisions: 5.0,
            unnoticed: 1.0,
            prior_factor: 10.0,
            longer: 3.0,
            longer_at_least: 1.2,
            moved_explains: 0.5,
            longer_than_moved: 1.5,
            inexact_gap: 0.05,
            much: 0.25,
        }
    }
}
