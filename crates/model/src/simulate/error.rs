//! Simulations that cannot be run.

/// A simulation that cannot be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimulateError {
    /// The input matrix does not have a column per input.
    #[error("the model has {needed} inputs, the signal has {got}")]
    Inputs {
        /// Inputs of the model.
        needed: usize,
        /// Columns of the signal.
        got: usize,
    },
    /// The initial state has the wrong length.
    #[error("the model has {needed} states, the initial state has {got}")]
    InitialState {
        /// States of the model.
        needed: usize,
        /// Length of the initial state.
        got: usize,
    },
    /// Time stamps and input samples differ in number.
    #[error("there are {time} time stamps and {input} input samples; every sample needs its time")]
    Samples {
        /// Time stamps.
        time: usize,
        /// Rows of the input.
        input: usize,
    },
    /// A signal holds NaN or infinity.
    #[error(
        "input {input} (counted from 0) is {value} at sample {sample}: every input sample must be finite"
    )]
    NotFinite {
        /// Input, counted from 0.
        input: usize,
        /// Sample, counted from 0.
        sample: usize,
        /// The value.
        value: f64,
    },
    /// Time stamps off the grid of a sampled model.
    #[error(
        "time is {time_s} s at sample {sample}, where the model's sample time asks for {due_s} s; resample, or leave the time stamps out"
    )]
    Grid {
        /// Sample, counted from 0.
        sample: usize,
        /// Time there.
        time_s: f64,
        /// Time on the model's grid.
        due_s: f64,
    },
    /// Time stamps that do not increase.
    #[error("time goes from {before_s} s to {after_s} s at sample {sample}; it must increase")]
    Time {
        /// Sample, counted from 0.
        sample: usize,
        /// Time before.
        before_s: f64,
        /// Time there.
        after_s: f64,
    },
    /// The state is no longer finite.
    #[error(
        "the simulation explodes: the state is no longer finite at t = {time_s} s; the model is unstable or its units are wrong"
    )]
    Explodes {
        /// The time, s.
        time_s: f64,
    },
    /// An integration backwards in time.
    #[error(
        "the integration is to run from {from_s} s to {to_s} s; it can only run forwards, over finite times"
    )]
    Backwards {
        /// The start, s.
        from_s: f64,
        /// The end, s.
        to_s: f64,
    },
    /// A derivative that is not finite at a finite state.
    #[error(
        "the equations have no finite value at t = {time_s} s; check the initial state and the parameters there"
    )]
    Undefined {
        /// The time, s.
        time_s: f64,
    },
    /// An equation that has no finite value.
    #[error("{0}; the model is undefined there: check initial state, parameters and inputs")]
    Equation(crate::equations::explain::NonFinite),
    /// Neither an explicit nor an implicit method advances.
    #[error(
        "the equations are too stiff or change too abruptly at t = {time_s} s ({steps} steps, the last of {step_s:e} s); \
         look for time constants far below the sample time, or for a jump in a derivative there"
    )]
    Stiff {
        /// The time, s.
        time_s: f64,
        /// Steps made.
        steps: usize,
        /// The last step, s.
        step_s: f64,
    },
    /// The same, with the state responsible.
    #[error(
        "the state `{state}` is too fast to simulate at t = {time_s} s: its time constant there is about {time_constant_s:.1e} s ({steps} steps so far); \
         replace it by its steady state, or correct the units of its parameters"
    )]
    TooFast {
        /// The state.
        state: String,
        /// Its time constant, s.
        time_constant_s: f64,
        /// The time, s.
        time_s: f64,
        /// Steps made.
        steps: usize,
    },
    /// A delay of an input that the model does not have.
    #[error("there is no input `{input}` to delay; the model has {known}", known = known.join(", "))]
    NoInput {
        /// The name given.
        input: String,
        /// The known inputs.
        known: Vec<String>,
    },
    /// An additional delay of a sampled model.
    #[error(
        "delays in addition to the model's own need a continuous model; {model} is sampled: write whole samples into its input_delay_s"
    )]
    SampledDelay {
        /// The model's name.
        model: String,
    },
    /// A sequence of losses has another length than the log.
    #[error("the sequence of dropped commands has {got} entries, the log has {needed} samples")]
    Drops {
        /// Samples of the log.
        needed: usize,
        /// Length of the sequence.
        got: usize,
    },
    /// Linearly interpolated commands on a path that requires held ones.
    #[error(
        "the path of input {input} (counted from 0) holds or bends the command, which is exact for held commands only; \
         hold the commands, or leave delays, lags and modes alone on that path"
    )]
    Joined {
        /// Input, counted from 0.
        input: usize,
    },
    /// Friction that alternates endlessly between sticking and sliding.
    #[error(
        "friction changes between sticking and sliding without end at t = {time_s} s; the friction levels do not fit the model"
    )]
    Contacts {
        /// The time, s.
        time_s: f64,
    },
    /// A black-box simulator reported an error.
    #[error("the simulator failed: {0}")]
    Called(String),
    /// Its result has another shape.
    #[error(
        "the simulator returned {got_rows} × {got_columns} numbers; it must return one row per sample and one column per output, {rows} × {columns}"
    )]
    Answer {
        /// Samples.
        rows: usize,
        /// Outputs.
        columns: usize,
        /// Rows returned.
        got_rows: usize,
        /// Columns returned.
        got_columns: usize,
    },
    /// Its result contains NaN or infinity.
    #[error(
        "the simulator returned {value} for `{output}` at sample {sample} (counted from 0, t = {time_s} s); every output must be finite"
    )]
    AnswerNotFinite {
        /// The output.
        output: String,
        /// Sample, counted from 0.
        sample: usize,
        /// The time, s.
        time_s: f64,
        /// The value.
        value: f64,
    },
    /// Measured outputs cannot correct the state of a black box.
    #[error(
        "a simulator that is only called cannot be corrected by measured outputs on its way: it has no state at hand; simulate it freely"
    )]
    Uncorrected,
    /// A simulator without inputs or outputs.
    #[error("the simulator has no {what}; name at least one")]
    NoChannel {
        /// Input or output.
        what: &'static str,
    },
    /// An empty or duplicate name.
    #[error("the {what} name `{name}` is empty or given twice; every {what} needs its own")]
    Name {
        /// Input, output, state or parameter.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// An invalid value.
    #[error(
        "{what} of `{name}` is {value}; it must be a finite number, a standard deviation at least 0"
    )]
    Value {
        /// Its description.
        what: &'static str,
        /// The name of the item.
        name: String,
        /// The value.
        value: f64,
    },
    /// An invalid delay.
    #[error(transparent)]
    DelayTime(#[from] deadtime_signal::time::TimeError),
}
