//! The check on withheld effects: cases whose cause is known to somebody else, diagnosed blindly, then scored against labels that were committed to beforehand.
//!
//! [`run`] sees the case folders only and writes one verdict each. [`score`] reads verdicts and labels, refuses labels that do not match the
//! commitments that came with the cases, and measures. The protocol and every score are defined in docs/blind.md.

mod bounds;
mod cases;
mod commitment;
pub(crate) mod error;
mod judge;
mod label;
mod limit;
mod load;
mod run;
mod run_time;
mod score;
mod scores;

pub use bounds::{bootstrap, wilson};
pub use cases::{COMMITMENT, CaseFiles, find};
pub use commitment::{check, commitments};
pub use error::BlindError;
pub use judge::{Claim, Judged, Judgement, judge};
pub use label::{AliasClass, Group, Label, LabelEffect};
pub use limit::{Limit, Verdict};
pub use load::{Scored, load};
pub use run::{Existing, Outcome, RunOptions, Summary, run, run_case};
pub use run_time::{RunFormat, RunTime};
pub use score::{BlindScore, Breakdown, Confusion, Reliability, Score, score};
pub use scores::{Definition, Measure, SCORES};
