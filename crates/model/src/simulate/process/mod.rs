//! A simulator that is a program: called afresh for every run with CSV in and CSV out, or kept running and asked over its standard input, line by line.
//!
//! How it can be wrong: a program that waits for more while we wait for its answer (every pipe has a thread of its own), one that never ends (a time-out for
//! every call), one that leaves children behind (it runs in a process group of its own, which is ended as a whole), and one that prints banners between
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
