//! What keeps a study from being planned, run or read.

use std::path::PathBuf;

use crate::text::shown;

/// A plan, a folder of results or a file of results that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StudyError {
    /// Neither a shipped plan nor a file.
    #[error("plan `{name}`: no such file, and no shipped plan of that name; there are: {known}", name = shown(name), known = known.join(", "))]
    UnknownPlan {
        /// What was asked for.
        name: String,
        /// The shipped plans.
        known: Vec<&'static str>,
    },
    /// The file is no `deadtime/plan@1`, or says what cannot be.
    #[error("plan {plan}: {detail}", plan = shown(plan))]
    Plan {
        /// The plan's name or file.
        plan: String,
        /// What is wrong, and the remedy.
        detail: String,
    },
    /// The folder holds another study, or one that was stopped.
    #[error("{folder}: {detail}", folder = folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// What is there, and the remedy.
        detail: String,
    },
    /// A file of results that cannot be read.
    #[error("{path}: {detail}", path = path.display())]
    Results {
        /// The file.
        path: PathBuf,
        /// What is wrong, and the remedy.
        detail: String,
    },
    /// A plan that needs more than it may.
    #[error(
        "plan {plan}: {settings} settings, {cells} cells and {estimates} estimates need about {needed_gb:.1} GB of {what}, at most {limit_gb} GB are allowed; \
         ask for less, or lift the limit by {option} {lifted}",
        plan = shown(plan), lifted = (1.1 * needed_gb).ceil()
    )]
    Budget {
        /// The plan's name.
        plan: String,
        /// Combinations of its lists.
        settings: f64,
        /// Settings times methods.
        cells: f64,
        /// Cells times trials.
        estimates: f64,
        /// Memory, or room on the disk.
        what: &'static str,
        /// 10⁹ bytes estimated.
        needed_gb: f64,
        /// 10⁹ bytes allowed.
        limit_gb: f64,
        /// The option that lifts the limit.
        option: &'static str,
    },
    /// The operating system gives no threads, or one stopped.
    #[error("no worker thread: {detail}")]
    Threads {
        /// What it said.
        detail: String,
    },
    /// Two studies that cannot be compared.
    #[error("{detail}")]
    Gate {
        /// What is wrong with which of them, and the remedy.
        detail: String,
    },
    /// A record that cannot be made.
    #[error("plan {plan}, {setting}, trial {trial} (seed {seed}): {source}")]
    Record {
        /// The plan's name.
        plan: String,
        /// The plant, input and delay that were asked for.
        setting: String,
        /// The record's number in its setting, from 0.
        trial: usize,
        /// The record's seed.
        seed: u64,
        /// Why not.
        source: Box<crate::Error>,
    },
}
