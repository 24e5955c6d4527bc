//! Accuracy on delays that were injected and so are known.

mod aim;
pub mod blind;
mod block_file;
mod blocks;
mod bound;
mod budget;
mod cell;
mod common;
pub mod compare;
mod error;
mod estimates;
mod feedback;
mod gate;
mod keys;
mod logging;
mod origin;
#[cfg(feature = "tables")]
mod parquet;
#[cfg(feature = "tables")]
mod parts;
mod passages;
mod plan;
mod plants;
mod published;
mod results;
mod run;
#[cfg(feature = "tables")]
mod seal;
mod setting;
mod tally;
mod timings;

pub use aim::{Aim, Measure, Reached};
pub use block_file::Damaged;
pub use budget::{Budget, Needs};
pub use common::{Common, CommonScore, MethodRow};
pub use error::{Error, Result, StudyError};
pub use gate::{Finding, Gate, GateGroup, GateReport, Measured};
pub use keys::{Delay, Drawn, Loop, Place, Truth};
pub use logging::Logging;
pub use origin::Origin;
#[cfg(feature = "tables")]
pub use parquet::{Values, columns};
#[cfg(feature = "tables")]
pub use parts::Tasks;
pub use plan::{Colour, Controller, Draw, Grid, Layout, PLANS, Plan, Scoring, Shown, Signal};
pub use plants::{PLANTS, Plant, PlantEntry};
pub use published::{Beside, Published, Standing, Statistic, Which};
pub use results::{Cell, FORMAT, Kept, Score, Study};
pub use run::{Begun, Progress, Runner};
pub use setting::Key;
pub use timings::{Speed, SpeedGate, SpeedReport, Timed, TimedPair, Timings};
