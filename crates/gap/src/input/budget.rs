//! The cost of a search: all counts and limits. There are three sets: for a model file, for one of many states, and for a simulator that can only be called.
//!
//! No count defines an effect. Too small a budget misses one, and a larger budget takes longer.

use deadtime_model::simulate::System;

/// The allowed cost of one kind of candidate. For a simulator that can only be called, effects at outputs and clocks are applied to a known run. Effects on its
/// inputs and parameters need calls.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Allowance {
    /// First guesses of one effect; the others are thinned evenly.
    pub(crate) first_guesses: usize,
    /// Candidates that are fitted after the screen, of inputs and of parameters each where they need calls.
    pub(crate) fitted: usize,
    /// The least gain of a candidate at its first guess for a fit, as a part of the search penalty.
    pub(crate) fitted_from: f64,
    /// Hypotheses of each size that are fitted on, and again once the noise is known.
    pub(crate) leaders: usize,
    /// Second effects that are fitted with each first one.
    pub(crate) seconds: usize,
    /// Pairs that are left after the first few steps.
    pub(crate) pairs: usize,
}

/// All counts and limits of a search.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Budget {
    /// Candidates without calls of their own; all candidates, for a model file.
    pub(crate) plain: Allowance,
    /// Candidates that need calls.
    pub(crate) called: Allowance,
    /// Runs come one after the other: calls in their order.
    pub(crate) one_by_one: bool,
    /// Starts of one candidate that are fitted.
    pub(crate) starts: usize,
    /// Single effects whose fit goes on after the first few steps.
    pub(crate) on: usize,
    /// Steps of a full fit, and of a fit that starts where another ended.
    pub(crate) steps: usize,
    /// Steps after which all but the best are given up.
    pub(crate) trial_steps: usize,
    /// Steps to either side that are tried for one parameter after a fit.
    pub(crate) polishes: usize,
    /// The number of estimates of the noise model from the leading hypothesis.
    pub(crate) rounds: usize,
    /// First effects of pairs: so many of the best, and so many more that have one parameter; leading singles are often flexible impostors.
    pub(crate) firsts: [usize; 2],
    /// First guesses of a candidate before any pair is fitted.
    pub(crate) glances: usize,
    /// Pairs whose members are tried as first effects in their turn.
    pub(crate) swapped: usize,
    /// First effects given which lost commands are searched.
    pub(crate) losing: usize,
    /// The part of the best gain from which lost commands are decoded again under another noise.
    pub(crate) again: f64,
    /// The same for delays of single commands, whose decoding costs less and was linear in the first noise.
    pub(crate) again_late: f64,
    /// Sequences of lost commands that are kept at a time.
    pub(crate) sequences: usize,
    /// Searches for lost commands, each with the last one's probability and parameters.
    pub(crate) passes: usize,
    /// The longest response to one command, in samples.
    pub(crate) response: usize,
    /// Leading hypotheses of each size that are compared again under other priors.
    pub(crate) rivals: usize,
    /// The perturbation of an initial state for its response, as a part of the prior's standard deviation. At this size rounding errors are small relative to
    /// the prior.
    pub(crate) start_push: f64,
    /// The same in an experiment that is simulated ahead, relative to the state's motion.
    pub(crate) ahead_push: f64,
    /// A relative change of a parameter for a derivative that is taken once.
    pub(crate) relative_step: f64,
}

/// The budget of a model file.
pub(crate) const MODEL_FILE: Budget = {
    let plain = Allowance {
        first_guesses: usize::MAX,
        fitted: 25,
        fitted_from: f64::NEG_INFINITY,
        leaders: 8,
        seconds: 6,
        pairs: 8,
    };
    Budget {
        plain,
        called: plain,
        one_by_one: false,
        starts: 2,
        on: 10,
        steps: 15,
        trial_steps: 3,
        polishes: 6,
        rounds: 2,
        firsts: [2, 4],
        glances: 3,
        swapped: 3,
        losing: 3,
        again: 0.8,
        again_late: 0.5,
        sequences: 32,
        passes: 2,
        response: 400,
        rivals: 6,
        start_push: 1e-3,
        ahead_push: 1e-3,
        relative_step: 1e-4,
    }
};

/// The budget of a simulator that can only be called, may be rough and slow.
pub(crate) const BLACK_BOX: Budget = Budget {
    called: Allowance {
        first_guesses: 10,
        fitted: 10,
        fitted_from: 0.2,
        leaders: 4,
        seconds: 3,
        pairs: 4,
    },
    one_by_one: true,
    start_push: 0.2,
    ahead_push: 1e-2,
    relative_step: 1e-2,
    ..MODEL_FILE
};

/// States from which a model is wide: the size of its catalogue grows with their number, and the cost of a simulation with its square.
const WIDE_FROM: usize = 25;

/// The budget of a wide model: a few first guesses of each candidate, and fewer fits.
pub(crate) const WIDE: Budget = {
    let plain = Allowance {
        first_guesses: 2,
        fitted: 10,
        leaders: 3,
        seconds: 2,
        pairs: 3,
        ..MODEL_FILE.plain
    };
    Budget {
        plain,
        called: plain,
        on: 5,
        polishes: 2,
        firsts: [1, 2],
        glances: 1,
        swapped: 1,
        losing: 1,
        rivals: 3,
        ..MODEL_FILE
    }
};

impl Budget {
    /// The budget of a system.
    pub(crate) fn of(system: &System) -> &'static Self {
        match (system.is_black_box(), system.states.len()) {
            (true, _) => &BLACK_BOX,
            (false, WIDE_FROM..) => &WIDE,
            (false, _) => &MODEL_FILE,
        }
    }
}
