//! The command line: one file per subcommand.

#![deny(clippy::indexing_slicing)]

// Its macro is in scope below it.
#[macro_use]
mod show;

mod aliases;
mod blind;
mod c2d;
mod check;
mod compare;
mod criteria;
mod demo;
mod estimate;
mod excite;
mod export;
mod files;
mod gap;
mod gate;
mod identify;
mod limit;
mod list;
mod log;
mod manual;
mod methods;
mod model;
mod picture;
mod program;
mod progress;
mod response;
mod simulate;
mod simulator;
mod source;
mod study;
mod watch;
mod words;

pub use limit::{LimitNotMet, NothingTrusted};
pub use program::{Cli, end_when_asked, main};
