//! Time-varying delays: whether one delay describes a record, where it changes, and the delay against time.

pub(crate) mod answer;
mod bent;
mod line;
mod live;
mod path;
mod rows;
mod smooth;
mod tracker;
pub(crate) mod watch;

pub use crate::track::tracker::online::{Alarm, Tracker, Tracking};
pub use crate::track::tracker::options::TrackerOptions;
pub use answer::{Anchor, AtOneDelay, Kind, Moving, Tracked, tracked};
pub use live::{Live, LiveOptions, Told};
pub use smooth::{Drift, Track};
pub use watch::{Stretch, Watch, Watched};
