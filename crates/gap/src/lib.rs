//! The gap between a simulator and a log: its size, its place, its cause, and how far it shrinks.
//!
//! The folders are the stages of a diagnosis, in this order, and `pipeline.rs` walks through them. A file imports from its own folder and from the folders
//! before it, never from a `mod.rs`.

mod error;
pub mod export;
mod format;

mod input;

mod baseline;

mod checks;

mod likelihood;

mod hypothesis;

mod search;

mod judge;

mod compose;

mod answer;

mod pipeline;

mod watch;

pub use answer::experiment::proposed;
pub use answer::force_profile::ForceProfile;
pub use answer::isolability::{Class, EffectVisibility, Isolability, IsolabilityFormat, Rival, Size};
pub use answer::traces::{CommandTrace, Trace};
pub use checks::inspection::{ChannelReport, Inspection, InspectionFormat, LogReport, Role, inspect};
pub use checks::topics::{ClockOffset, LogClocks, TopicClock, clocks};
pub use error::{Error, Result};
pub use format::caveat::{Caveat, Constancy};
pub use format::contributions::{Contribution, Description, Explained, Recalibration, Remainder, Share, Strength};
pub use format::diagnosis::{
    Cause, Check, CheckKind, Diagnosis, DiagnosisError, DiagnosisFormat, Gap, GapOutput, Holdout, HorizonError, Metric, Mode, NotTried,
    Prediction, RankedPair, RankedSingle, RankingRow, Shrink, ShrinkOutput,
};
pub use format::error::GapError;
pub use format::found::{FoundEffect, FoundParameter};
pub use format::nuisance::NuisanceEstimate;
pub use format::place::{Band, Regime, TimeSpan, Where, WhereOutput};
pub use format::progress::Stage;
pub use input::criteria::Criteria;
pub use input::options::GapOptions;
pub use input::subject::Subject;
pub use pipeline::{Diagnosed, diagnose, diagnose_files, isolability};
pub use watch::{ActingEffect, GapTold, GapWatch};
