//! Files: written as a whole, read within a limit, named safely, and a folder that one process at a time writes to.

mod error;
mod lock;
mod name;
mod read;
mod same;
mod unfinished;
mod write;

pub use error::FileError;
pub use lock::Lock;
pub use name::component;
pub use read::{LARGEST, read_bytes, read_text};
pub use same::SameFile;
pub use unfinished::abandon;
pub use write::{Begun, STANDARD_OUTPUT, sweep, write_atomic, write_lines};
