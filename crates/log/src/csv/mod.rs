//! Logs as text: a header row, a column of time, one row per sample; `.csv.gz` too. Columns may be separated by commas, semicolons, tabs, bars or blanks.
//!
//! Lines are read and counted here, not by the csv crate. Its positions are wrong after blank lines and in files with CRLF line ends; the row in a message is
//! the line in an editor. The csv crate splits lines with quotes.

mod cell;
pub(crate) mod clock;
mod date;
mod entities;
pub(crate) mod events;
pub(super) mod follow;
pub(super) mod frequency;
mod header;
mod instances;
mod lines;
mod number;
mod partial;
mod slashes;
mod sparse;
pub(crate) mod table;
pub(crate) mod time_name;
mod utf16;
mod write;

pub use crate::header::name_and_unit;
pub use events::{EventTimes, read_events, read_events_from};
pub use table::{read_from, read_records, read_records_from, recording_from, records};
