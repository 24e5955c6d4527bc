//! The gap between a simulator and a log: its size, its place, its cause, and how far it shrinks.

mod diagnosis;

pub use diagnosis::{
    Band, Cause, Check, CheckKind, Diagnosis, DiagnosisError, DiagnosisFormat, FoundEffect, Gap, GapOutput, Holdout, Metric, Mode,
    NotTried, Parameter, Prediction, RankedPair, RankedSingle, RankingRow, Regime, Shrink, ShrinkOutput, TimeSpan, Where, WhereOutput,
};
