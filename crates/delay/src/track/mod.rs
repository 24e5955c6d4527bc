//! Delays that move: whether one delay describes a record, where it changes, and the delay against time.

mod answer;
mod live;
mod path;
mod rows;
mod smooth;
mod tracker;
mod watch;

pub use answer::{Anchor, AtOneDelay, Kind, Moving, Tracked, tracked};
pub use live::{Live, LiveOptions, Told};
pub use smooth::{Drift, Track};
pub use tracker::{Alarm, Tracker, TrackerOptions, Tracking};
pub use watch::{Stretch, Watch, Watched};
