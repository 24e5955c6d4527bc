//! A simulator that is a program: called afresh for every run with CSV in and CSV out, or kept running and asked over its standard input, line by line.
//!
//! How it can be wrong: both sides wait for each other (every pipe has a thread of its own); a program never ends (every call has a
//! time-out); it leaves children behind (it runs in a process group of its own, which is ended as a whole); it prints banners between
//! its numbers (everything but a row of numbers under the named columns is an error that quotes the line).

mod child;
mod command;
mod persistent;
mod program;
mod table;
#[cfg(test)]
mod tests;

pub use child::Children;
pub use program::{Program, Talk};
