//! The run time of a diagnosis, as a file in its folder.

use serde::{Deserialize, Serialize};

/// The format line of a run time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum RunFormat {
    /// The only format there is.
    #[default]
    #[serde(rename = "deadtime/blind-run@1")]
    V1,
}

/// `VERDICTS/ID/run.json`: how long the diagnosis took. It is written last and so marks a case as done.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RunTime {
    /// The format line.
    pub format: RunFormat,
    /// Wall-clock time of the diagnosis, s.
    pub time_s: f64,
}
