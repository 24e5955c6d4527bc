//! What stops a match of two models.

/// An identified model, a structured one and the options do not go together.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MatchingError {
    /// A name that is no parameter of the structured model.
    #[error("the structured model has no parameter `{name}`; it has {} and the delays {}", parameters.join(", "), delays.join(", "))]
    NoParameter {
        /// The name.
        name: String,
        /// Its parameters.
        parameters: Vec<String>,
        /// Its delays, as they are named.
        delays: Vec<String>,
    },
    /// No parameter is free.
    #[error("no parameter is free: name some, or `all`")]
    NothingFree,
    /// An input of the identified model that the structured one lacks.
    #[error("the identified model's input `{name}` is none of the structured model's ({}): give both the same names", known.join(", "))]
    NoInput {
        /// The input.
        name: String,
        /// The structured model's inputs.
        known: Vec<String>,
    },
    /// No output is in both.
    #[error("the models share no output: the identified one has {}, the structured one {}; give both the same names", identified.join(", "), structured.join(", "))]
    NoOutput {
        /// The identified model's outputs.
        identified: Vec<String>,
        /// The structured model's.
        structured: Vec<String>,
    },
    /// One channel in two units.
    #[error(
        "`{name}` is in {identified} in the identified model and in {structured} in the structured one: bring both to one unit"
    )]
    Unit {
        /// The channel.
        name: String,
        /// Its unit in the identified model.
        identified: String,
        /// Its unit in the structured model.
        structured: String,
    },
    /// A name of `units` or `at` that nothing has.
    #[error("{option}: there is no `{name}` among {}", known.join(", "))]
    NoName {
        /// Which option.
        option: &'static str,
        /// The name.
        name: String,
        /// What there is.
        known: Vec<String>,
    },
    /// A number that an option cannot have.
    #[error("{option} is {value}: {rule}")]
    Option {
        /// Which option.
        option: &'static str,
        /// The value.
        value: f64,
        /// What it must be.
        rule: String,
    },
    /// A model has parts that have no frequency response.
    #[error("the model {model} has {what}, which has no place in a frequency response: {remedy}")]
    Unsupported {
        /// The model's name.
        model: String,
        /// What it has.
        what: &'static str,
        /// What to do instead.
        remedy: &'static str,
    },
    /// The file is no linear model.
    #[error("{path}: {found} is no identified model; give the model file that `identify` wrote, or its report", path = path.display())]
    NotIdentified {
        /// The file.
        path: std::path::PathBuf,
        /// What it is.
        found: String,
    },
    /// The structured model has no finite response even at its file's values.
    #[error(
        "the model {model} has no finite response at the file's values and the operating point: a slope there is not finite, or a pole lies on \
         a frequency of the band; say where it is linearised (at) or choose another band"
    )]
    NoResponse {
        /// The model's name.
        model: String,
    },
    /// No search ended at a minimum.
    #[error(
        "the search for the parameters of {model} did not end at a minimum after {steps} steps (norm of the difference {difference:.3e}): free fewer parameters, \
         choose another band or norm, or hold the values by a prior"
    )]
    NoMinimum {
        /// The structured model's name.
        model: String,
        /// Steps that were taken, at most.
        steps: usize,
        /// The norm of the difference there.
        difference: f64,
    },
}
