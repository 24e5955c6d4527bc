//! Limits of a diagnosis that a reader must know.

use deadtime_signal::remedy::{Message, Words};

/// Something that weakens a diagnosis, as a sentence.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Caveat {
    /// A held-out log with the samples of a training log.
    #[error(
        "{held} holds the same samples as {learnt}, a training log: the reduction is not measured on unseen data; hold out another log"
    )]
    HeldOutIsTraining {
        /// The held-out log.
        held: String,
        /// The training log.
        learnt: String,
    },
    /// Candidates without a name from the caller.
    #[error(
        "candidates were tried next to the catalogue, the terms that describe the residual of the training logs best: {}",
        terms.join(", ")
    )]
    Suggested {
        /// The terms, as a candidate is written.
        terms: Vec<String>,
    },
    /// A size that depends on the order of effects.
    #[error(
        "effects on `{channel}` act in the order {first}, {second}; before {first} the {parameter} of {second} is {before:.4} in place of {value:.4}"
    )]
    Order {
        /// The gain.
        first: String,
        /// The effect after it.
        second: String,
        /// Where both act.
        channel: String,
        /// Its parameter.
        parameter: String,
        /// The value after the gain.
        value: f64,
        /// The value before it.
        before: f64,
    },
    /// Two training logs with the same samples.
    #[error(
        "{second} holds the same samples as {first}: they count twice, and the intervals are too narrow; leave one out"
    )]
    Twice {
        /// The first of them.
        first: String,
        /// The other.
        second: String,
    },
    /// Only the first part of a long log was used.
    #[error(
        "{log} has {rows} rows, of which the first {used} were looked at, up to {until_s} s: everything here, intervals too, is of that part alone; \
         ask for more rows to be looked at, or cut the log to look at another part"
    )]
    FirstPart {
        /// The log.
        log: String,
        /// Its rows.
        rows: usize,
        /// The used rows.
        used: usize,
        /// The end of that part from the log's first sample, s.
        until_s: String,
    },
    /// The error of the found effects in the unused rows.
    #[error(
        "later rows of {log}, not looked at: a free run from the log's start is off by {before} there as the model came and by {after} with what was found (nrmse), \
         by {within} in what was looked at: {}", if *.holds { "it holds there" } else { "something changes later, or adds up; cut the log to look there" }
    )]
    LaterRows {
        /// The log.
        log: String,
        /// The error there of the nominal model, as nrmse over all outputs.
        before: String,
        /// The same with the found effects.
        after: String,
        /// With the found effects, in the used rows.
        within: String,
        /// The error there is about as large as in the used rows.
        holds: bool,
    },
    /// Measured about another level than the model's.
    #[error(
        "{levels}: the model may be one of deviations from an operating point; give the channels `operating = \"mean\"` in the model file, commands too, \
         or start the model where the log starts"
    )]
    OtherOperatingPoint {
        /// For each output its mean as measured and as modelled, and how far it moves.
        levels: String,
    },
    /// The model is worse than a constant, and the found effects do not repair it.
    #[error(
        "the model as it came misses `{output}` by {percent} % of its spread, so a constant would be nearer, and what was found leaves {left} %: \
         it is a poor model of these logs, and a cause is only what corrects it best; look at its parameters, signs, units and start first"
    )]
    PoorModel {
        /// The output.
        output: String,
        /// The error of the nominal model.
        percent: String,
        /// With the found effects.
        left: String,
    },
    /// A single effect lowers a small gap, and so do the model's numbers together.
    #[error(
        "`{effect}` would lower this small gap; the model's own numbers, each a little off, explain as much, so it is not named: \
         {remedy}"
    )]
    OfTheNumbers {
        /// The effect, with its channel.
        effect: String,
        /// The command that fits the parameters.
        remedy: Message,
    },
    /// An angle that is logged within one turn, and not declared as one.
    #[error(
        "`{channel}` jumps by a whole turn {times} times in the logs, which the machine does not: give it `kind = \"angle\"` in the model file, or take the turns out of the \
         column; until then no result about it can be trusted"
    )]
    WholeTurns {
        /// The channel.
        channel: String,
        /// The number of jumps.
        times: usize,
    },
    /// A command that is constant in the training logs.
    #[error(
        "`{input}` never changes in the training logs: no effect on it is detectable; record a log in which it moves"
    )]
    ConstantInput {
        /// The input.
        input: String,
    },
    /// An output without a sample in the training logs.
    #[error("`{output}` has no sample in the training logs: it is left out")]
    NothingToLearn {
        /// The output.
        output: String,
    },
    /// Calls of a simulator failed; the hypotheses that made them are dropped.
    #[error(
        "the simulator failed in {failed} of {calls} calls, and what asked for them was given up; the last time: {why}"
    )]
    SimulatorFailed {
        /// Calls that failed.
        failed: usize,
        /// All calls.
        calls: usize,
        /// The last failure.
        why: String,
    },
    /// No output of a simulator depends on an input.
    #[error("no output of the simulator depends on `{input}`: effects on it were not tried")]
    InputMovesNothing {
        /// The input.
        input: String,
    },
    /// No output of a simulator depends on a parameter.
    #[error(
        "a tenth more or less of the parameter `{parameter}` moves no output: the simulator does not apply it, or these logs do not show it"
    )]
    ParameterMovesNothing {
        /// The parameter.
        parameter: String,
    },
    /// No output of a simulator depends on a start.
    #[error(
        "no output of the simulator depends on the start of `{state}`: it counts as exactly known"
    )]
    StartMovesNothing {
        /// The state.
        state: String,
    },
    /// A simulator without a named initial state.
    #[error(
        "no state of the simulator is named: every log is taken to start exactly as the simulator does; a start that is off passes for an effect"
    )]
    NoStart,
    /// A simulator whose response to its initial state lasts to the end of a log.
    #[error(
        "of a perturbation of the initial state {left} is left at the end of the log: the simulator integrates, and what is a little off at first stays so{}",
        if *started { "" } else { "; name its states with their uncertainty" }
    )]
    NeverForgets {
        /// The part of the perturbation at the end of the log.
        left: String,
        /// Starts are named.
        started: bool,
    },
    /// An unstable simulator.
    #[error(
        "a perturbation of the initial state grows {factor}-fold over the log: the simulator is unstable there, and small causes pass for large ones; close the loop inside it, or cut the logs into shorter ones"
    )]
    Grows {
        /// The growth factor.
        factor: String,
    },
    /// A simulator whose free run is nowhere near the log, as one that fell over and came to rest.
    #[error(
        "the free run of the simulator has left the log: it misses `{output}` by {times} times what that moves and goes its own way{}. So does an unstable machine that fell over, \
         and no effect that is named here is trustworthy; name the log's channels of its states, from which it is then started again and again ({states}), \
         or close the loop inside the simulator", grown.as_ref().map_or_else(String::new, |grown| format!(", and a perturbation of the initial state grows {grown}-fold"))
    )]
    LeftTheLog {
        /// The output.
        output: String,
        /// The size of the miss, in units of the motion.
        times: String,
        /// The growth of a perturbation of the initial state, where a state is named.
        grown: Option<String>,
        /// The option that names the log's channels of its states.
        states: Message,
    },
    /// A simulator with a visible response to a negligible change of its inputs.
    #[error(
        "a change of the inputs by 1e-10 moves `{output}` by {percent} % of its motion: the simulator is rough or chaotic, and no effect smaller than that is detectable"
    )]
    Rough {
        /// The output.
        output: String,
        /// The size, in percent.
        percent: String,
    },
    /// Something is left that effects on equations might explain, which a black box does not let anyone try.
    #[error(
        "what was found leaves {times} times the noise, and effects on equations (friction, drag and the like) could not be tried: one of them may be the cause instead; name them as parameters of the simulator, or diagnose a model in equations"
    )]
    Incomplete {
        /// The residual over the floor.
        times: String,
    },
    /// A residual above the noise floor remains after the reported effects.
    #[error(
        "given the reported effects, {times} times the noise floor remain of `{output}`: something else differs too"
    )]
    Rest {
        /// The residual over the floor.
        times: String,
        /// The output on which the verdict was decided.
        output: String,
    },
    /// A latent sequence that is unknown to a simulation.
    #[error(
        "which commands were lost or late is known of these logs only, so the model that is written carries {instead} in place of {effects}: \
         what it does on average. To try a controller against chance, draw from {effects} with the parameters given"
    )]
    HandedOver {
        /// The found effects.
        effects: String,
        /// Their replacement in the model.
        instead: String,
    },
    /// The found effects do not improve a simulation of held-out data.
    #[error(
        "{effects} explains the logs, but a simulation of held-out data is no better with it: the model that is written leaves it out"
    )]
    LeftOut {
        /// The found effects.
        effects: String,
    },
    /// A constant among the found effects, which the logs need not share.
    #[error(
        "`{effect}:{channel}` is a constant{}. If it may differ from log to log, declare it in the model file: `[[nuisances]]` with `effect = \"{effect}\"`, \
         `channel = \"{channel}\"` and its `std`", constancy.words()
    )]
    Constant {
        /// The effect.
        effect: String,
        /// Where it acts.
        channel: String,
        /// Whether it is one in all logs.
        constancy: Constancy,
    },
    /// A nuisance whose value its prior contradicts.
    #[error(
        "the nuisance `{nuisance}` is {value} in {log}, more than three times its `std` of {std}: widen that, or take the entry out to have it judged as a cause"
    )]
    NuisanceBeyondPrior {
        /// The nuisance.
        nuisance: String,
        /// Value and standard deviation.
        value: String,
        /// The log.
        log: String,
        /// The standard deviation of its prior.
        std: String,
    },
    /// A nuisance that is alike in all logs.
    #[error(
        "the nuisance `{nuisance}` is {value}, alike in all logs: so it may be a cause, and takes no part in the gap; take the entry out to have it judged"
    )]
    NuisanceAlike {
        /// The nuisance.
        nuisance: String,
        /// Value and standard deviation over all logs.
        value: String,
    },
    /// An output without a sample in the held-out data.
    #[error("`{output}` has no sample in what is held out: how far its gap shrinks is not known")]
    NothingHeldOut {
        /// The output.
        output: String,
    },
}

/// Whether a constant is one in all training logs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Constancy {
    /// There is one log, or none that shows it.
    NotKnown,
    /// The difference of the logs is not significant.
    Alike,
    /// They differ by more.
    Differs {
        /// The value in each.
        values: String,
    },
}

impl Constancy {
    fn words(&self) -> String {
        match self {
            Self::NotKnown => String::new(),
            Self::Alike => ", alike in all logs within chance".to_owned(),
            Self::Differs { values } => {
                format!(": {values}. It is another in every log, so a trim rather than a cause")
            }
        }
    }
}

impl Caveat {
    /// The caveat with its remedy in the words of a face.
    pub(crate) fn word(&mut self, words: Words) {
        if let Self::OfTheNumbers { remedy, .. } | Self::LeftTheLog { states: remedy, .. } = self {
            remedy.word(words);
        }
    }

    /// Whether this caveat must be resolved before any other result is trustworthy.
    #[must_use]
    pub fn comes_first(&self) -> bool {
        matches!(
            self,
            Self::OtherOperatingPoint { .. }
                | Self::PoorModel { .. }
                | Self::LeftTheLog { .. }
                | Self::WholeTurns { .. }
        )
    }
}
