//! A simulator that is a program. The program is started for every run with CSV in and CSV out, or kept running with requests on its standard input, line by
//! line.
//!
//! How it can be wrong: both sides wait for each other (every pipe has a thread of its own). A program never ends (every call has a time-out). The program
//! leaves children behind (it runs in a process group, which is ended as a whole). The program prints banners between its rows (any line other than a row of
//! the named columns is an error that quotes the line).

mod child;
mod command;
mod persistent;
mod program;
mod table;
#[cfg(test)]
mod tests;

pub use child::Children;
pub use program::{Program, Talk};
