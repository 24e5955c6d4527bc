//! Errors of a match between two models.

/// The identified model, the structured one and the options are incompatible.
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
        /// The names of its delays.
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
    /// The models have no output in common.
    #[error("the models share no output: the identified one has {}, the structured one {}; give both the same names", identified.join(", "), structured.join(", "))]
    NoOutput {
        /// The identified model's outputs.
        identified: Vec<String>,
        /// The structured model's outputs.
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
    /// An unknown name in `units` or `at`.
    #[error("{option}: there is no `{name}` among {}", known.join(", "))]
    NoName {
        /// The option.
        option: &'static str,
        /// The name.
        name: String,
        /// The known names.
        known: Vec<String>,
    },
    /// An option out of its range.
    #[error("{option} is {value}: {rule}")]
    Option {
        /// The option.
        option: &'static str,
        /// The value.
        value: f64,
        /// The valid range.
        rule: String,
    },
    /// A model with parts that have no frequency response.
    #[error("the model {model} has {what}, which has no place in a frequency response: {remedy}")]
    Unsupported {
        /// The model's name.
        model: String,
        /// The unsupported part.
        what: &'static str,
        /// The remedy.
        remedy: &'static str,
    },
    /// The file is no linear model.
    #[error("{path}: {found} is no identified model; give the model file that `identify` wrote, or its report", path = path.display())]
    NotIdentified {
        /// The file.
        path: std::path::PathBuf,
        /// The actual kind of file.
        found: String,
    },
    /// The structured model has no finite response even at the file's values.
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
        /// Largest number of steps.
        steps: usize,
        /// The norm of the difference at the end.
        difference: f64,
    },
}
