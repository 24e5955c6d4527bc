//! Simulation: linear models exactly, for held and interpolated inputs and delays of any size; nonlinear ones from edge to edge of their inputs.
//!
//! `lsim` is the response of a linear model without effects. [`System::simulate`] runs a simulator of any kind under a [`Plan`] of hooks on inputs, dynamics,
//! outputs and clock. The mapping from effects to hooks is defined elsewhere.

mod assembly;
mod black_box;
pub(crate) mod error;
mod field;
mod history;
mod linear;
pub(crate) mod lsim;
mod nonlinear;
pub mod ode;
pub(crate) mod piecewise;
pub mod plan;
pub mod process;
mod response;
pub(crate) mod run;
mod sampled;
pub(crate) mod simulator;
pub(crate) mod system;
mod walk;

/// The hold of the input between samples.
pub use crate::c2d::hold::Hold;
pub use crate::matrices::Matrices;
pub use black_box::windows;
pub use black_box::{Face, Remembered, Start};
pub use error::SimulateError;
pub use lsim::{Grid, Options, Prehistory, Responds, Response, lsim};
pub use piecewise::{Piece, Piecewise};
pub use plan::{
    Delays, Drops, Late, Losses, Mode, Plan, Realisation, Source, Switch, Term, Tolerance, Wanted,
};
pub use response::{
    impulse_response, impulse_response_sampled, step_response, step_response_sampled,
};
pub use run::Commands;
pub use simulator::{Port, Restart, Simulator};
pub use system::{Dynamics, ModelNumber, System};
pub use walk::{Correction, Measured, Run};
