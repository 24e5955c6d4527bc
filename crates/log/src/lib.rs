//! Measured logs: time stamps and named channels, checked once when built; one reader per file format.
//!
//! NaN and infinities never leave this module: a flag marks a missing sample, and only outputs may have one.

// The content of a file decides the places of the reads: no index is taken for granted.
#![deny(clippy::indexing_slicing)]
#![cfg_attr(test, allow(clippy::too_many_lines, reason = "tests are lists of cases"))]

mod align;
mod arrays;
#[cfg(feature = "tables")]
mod arrow;
mod bag;
mod budget;
mod channels;
#[cfg(feature = "tables")]
mod columns;
mod counted;
pub mod csv;
mod drift;
mod error;
mod folder;
mod frequency;
#[cfg(test)]
mod fuzz;
mod grid;
#[cfg(feature = "tables")]
mod guard;
#[cfg(feature = "tables")]
mod hdf5;
mod header;
mod listing;
mod mat;
mod mcap;
mod mcos;
mod notes;
mod numbers;
mod options;
#[cfg(feature = "tables")]
mod pages;
#[cfg(feature = "tables")]
mod parquet;
mod place;
mod protobuf;
mod reader;
mod recording;
mod ros;
mod ros_types;
mod rosbag2;
mod scalar;
mod sentinel;
mod sqlite;
mod step;
#[cfg(test)]
mod tests;
mod turns;
mod ulog;

pub use crate::csv::events::{EventTimes, read_events};
pub use crate::csv::follow::{Follower, News, Polled, Row};
pub use crate::csv::frequency::{read_frequency_response, read_frequency_response_from};
pub use crate::csv::table::read_records;
pub use align::Wanted;
pub use channels::{Channel, Log, Output};
pub use error::{Error, LogError};
pub use frequency::{FrequencyError, FrequencyResponse, Quality};
pub use header::name_and_unit;
pub use listing::{ChannelListing, GapListing, Listing, TopicListing};
pub use notes::Notes;
pub use options::{ReadOptions, Stamps, TimeUnit};
pub use place::{Place, neighbours};
pub use reader::{READERS, Reader, open, read, reader};
pub use recording::{Recording, Topic};
pub use step::STEP;
