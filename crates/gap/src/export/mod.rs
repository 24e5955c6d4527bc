//! The export of a diagnosis: ranges for domain randomisation, settings of other simulators, transfer functions with delay.
//!
//! A target is one file here and one line in [`TARGETS`]. How an export can be wrong: the intervals of a diagnosis are those of one machine and its logs, so
//! they are narrow. [`Source::widen`] adapts them to fleets. Effects without a place in a target are listed with the reason, and never dropped.

mod domain_randomisation;
mod isaaclab;
mod mujoco;
mod node;
mod ranges;
pub(crate) mod source;
mod target;
mod targets;
mod transfer_function;

pub use domain_randomisation::DomainRandomisation;
pub use isaaclab::IsaacLab;
pub use mujoco::MuJoCo;
pub use node::Node;
pub use ranges::{Noise, Operation, Range, Ranges};
pub use source::{ExportError, Source};
pub use target::{Syntax, Target};
pub use targets::{TARGETS, export};
pub use transfer_function::Transfer;
