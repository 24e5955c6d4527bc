//! The gap between a simulator and a log: its size, its place, its cause, and how far it shrinks.
//!
//! The folders are the stages of a diagnosis, in this order, and `pipeline.rs` walks through them. A file imports from its own folder and from the folders
//! before it, never from a `mod.rs`.

mod error;
pub mod export;
mod format;

mod input;

mod baseline;

mod causes;
mod checks;

mod likelihood;

mod hypothesis;

mod search;

mod judge;

mod answer;

mod pipeline;

mod watch;

pub use crate::answer::diagnosed::Diagnosed;
pub use crate::answer::force_profile::ForceProfile;
pub use crate::answer::isolability::{
    Class, EffectVisibility, Isolability, IsolabilityFormat, Rival, Size,
};
pub use crate::answer::traces::{CommandTrace, Trace};
pub use crate::checks::inspection::{
    ChannelReport, Inspection, InspectionFormat, LogReport, Role, inspect,
};
pub use crate::checks::topics::{ClockOffset, LogClocks, TopicClock, clocks};
pub use crate::format::caveat::{Caveat, Constancy};
pub use crate::format::class::{CauseClass, Grounds, Member, in_words, listed};
pub use crate::format::contributions::{
    Contribution, Description, Explained, Recalibration, Remainder, Share, Strength, Unrelated,
};
pub use crate::format::diagnosis::{
    Cause, Check, CheckKind, Diagnosis, DiagnosisError, DiagnosisFormat, Gap, GapOutput, Holdout,
    HorizonError, Metric, Mode, NotTried, Prediction, RankedPair, RankedSingle, RankingRow, Shrink,
    ShrinkOutput,
};
pub use crate::format::error::GapError;
pub use crate::format::errors_by_mode::{BeforeAfter, ErrorsByMode, OverHorizon};
pub use crate::format::found::{FoundEffect, FoundParameter};
pub use crate::format::next_experiment::{Advice, NextExperiment, Proposal, Signal};
pub use crate::format::nuisance::NuisanceEstimate;
pub use crate::format::place::{Band, Regime, TimeSpan, Where, WhereOutput};
pub use crate::format::progress::Stage;
pub use crate::input::criteria::Criteria;
pub use crate::input::options::GapOptions;
pub use crate::input::subject::Subject;
pub use error::{Error, Result};
pub use pipeline::{diagnose, diagnose_files, isolability};
pub use watch::{ActingEffect, GapTold, GapWatch};
