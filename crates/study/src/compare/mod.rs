//! Results side by side: diagnoses before and after a repair, the machines of a fleet, studies of two versions.

mod diagnoses;
mod studies;

pub use diagnoses::{
    CausePart, CauseRow, CauseValue, Diagnoses, GapStanding, ParameterRow, diagnoses,
};
pub use studies::{MethodRow, Studies, StudyStanding, studies};

use serde::{Deserialize, Serialize};

/// The format line of the output.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum CompareFormat {
    /// The only one so far.
    #[default]
    #[serde(rename = "deadtime/compare@1")]
    V1,
}
