//! The errors of cases, verdicts and labels.

use std::path::PathBuf;

use deadtime_signal::remedy::{Message, Remedied, Remedy};

/// Blind cases, verdicts or labels that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BlindError {
    /// A folder without a single case.
    #[error("{folder}: no case in it; a case is a folder with model.toml, train_1.csv, holdout_1.csv and commitment.txt", folder = folder.display())]
    NoCases {
        /// The folder.
        folder: PathBuf,
    },
    /// A folder without a single label.
    #[error("{folder}: no label in it; a label is a file ID.json", folder = folder.display())]
    NoLabels {
        /// The folder.
        folder: PathBuf,
    },
    /// A case lacks a file.
    #[error("{folder}: {file} is missing; a case needs model.toml (or .json), train_*.csv, holdout_*.csv and commitment.txt", folder = folder.display())]
    Missing {
        /// The case's folder.
        folder: PathBuf,
        /// The file, or the pattern that none matches.
        file: &'static str,
    },
    /// Two files of which only one is allowed.
    #[error("{folder}: both {first} and {second}; keep one", folder = folder.display())]
    Ambiguous {
        /// The case's folder.
        folder: PathBuf,
        /// One file.
        first: &'static str,
        /// The other.
        second: &'static str,
    },
    /// A case's name is no text.
    #[error("{folder}: the folder's name is not UTF-8; rename it", folder = folder.display())]
    BadName {
        /// The case's folder.
        folder: PathBuf,
    },
    /// The diagnoser stopped with a panic.
    #[error("case {id}: the diagnosis panicked: {message}")]
    Panicked {
        /// The case.
        id: String,
        /// The message of the panic.
        message: String,
    },
    /// Not a label.
    #[error("{file}: not a label of deadtime/blind@1: {source}", file = file.display())]
    Label {
        /// The label's file.
        file: PathBuf,
        /// The error of serde.
        source: serde_json::Error,
    },
    /// A label called otherwise than its file.
    #[error("{file}: its id is `{id}`; file name and id must be the same", file = file.display())]
    LabelId {
        /// The label's file.
        file: PathBuf,
        /// The id in it.
        id: String,
    },
    /// A label whose effects do not fit its group.
    #[error("label of case {id}: group {group} needs {needed} effects, it has {got}")]
    LabelEffects {
        /// The case.
        id: String,
        /// The group.
        group: &'static str,
        /// The number of effects of the group.
        needed: usize,
        /// The number of effects of the label.
        got: usize,
    },
    /// A label with an effect that lacks its name or channel.
    #[error(
        "label of case {id}: an effect without name or channel; only what stands outside the catalogue may lack them"
    )]
    LabelNameless {
        /// The case.
        id: String,
    },
    /// The salt cannot be found in the label's text.
    #[error(
        "label of case {id}: no text `salt` among its top-level members; the commitment cannot be checked without it"
    )]
    NoSalt {
        /// The case.
        id: String,
    },
    /// A commitment that is no SHA-256.
    #[error("case {id}: commitment.txt holds `{found}`, not 64 hexadecimal digits")]
    BadCommitment {
        /// The case.
        id: String,
        /// Its content instead.
        found: String,
    },
    /// No commitment for these cases.
    #[error("{}", self.remedied().unwrap_or_default())]
    NoCommitment {
        /// The cases.
        ids: Vec<String>,
    },
    /// The commitment stored with the verdict differs from the one stored with the case.
    #[error("case {ids}: the commitment of the verdict differs from that of the case", ids = ids.join(", "))]
    CommitmentChanged {
        /// The cases.
        ids: Vec<String>,
    },
    /// Labels that were changed after they were committed to.
    #[error("case {ids}: the label (or its salt) does not match its commitment; nothing was scored", ids = ids.join(", "))]
    Changed {
        /// The cases.
        ids: Vec<String>,
    },
    /// Labels and verdicts that do not belong together.
    #[error(
        "labels and verdicts differ: no case or verdict for the labels [{labels}]; no label for the verdicts [{verdicts}]",
        labels = labels.join(", "), verdicts = verdicts.join(", ")
    )]
    Unpaired {
        /// Labels without case or verdict.
        labels: Vec<String>,
        /// Verdicts without label.
        verdicts: Vec<String>,
    },
    /// A run-time file that cannot be read.
    #[error("{file}: not a deadtime/blind-run@1: {source}", file = file.display())]
    RunTime {
        /// The file.
        file: PathBuf,
        /// The error of serde.
        source: serde_json::Error,
    },
    /// A limit that is not written as one.
    #[error("limit `{text}`: write it as NAME>=VALUE or NAME<=VALUE")]
    LimitSyntax {
        /// The text given.
        text: String,
    },
    /// A limit on something that is not measured.
    #[error("there is no score `{name}`; there are: {known}", known = known.join(", "))]
    UnknownScore {
        /// The name given.
        name: String,
        /// The names there are.
        known: Vec<&'static str>,
    },
}

impl Remedied for BlindError {
    fn remedied(&self) -> Option<Message> {
        match self {
            Self::NoCommitment { ids } => Some(
                Message::from(format!(
                    "no commitment.txt for case {}; give the folder of the cases by ",
                    ids.join(", ")
                ))
                .and(Remedy::Cases),
            ),
            _ => None,
        }
    }
}
