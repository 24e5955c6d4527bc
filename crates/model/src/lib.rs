//! Linear models, their conversion between continuous and sampled time, their optimal gains, nonlinear models as equations, and the model file.

mod balance;
pub mod c2d;
mod cascade;
mod d2c;
mod derived;
pub mod effect;
mod equations;
mod error;
mod file;
mod hinf;
mod interconnection;
#[cfg(test)]
mod laws;
mod lyapunov;
mod matrices;
mod matrix;
mod nu_gap;
mod pade;
mod parts;
mod riccati;
mod shape;
pub mod simulate;
mod state_space;
mod transfer_function;
pub mod uav;
mod zeros;

pub use crate::equations::error::{EquationError, Fault};
pub use crate::equations::explain::{Breakdown, NonFinite};
pub use crate::equations::system::{
    Definition, Directions, Equations, OutputVariable, Parameter, StateVariable, Symbol, Workspace,
    Wrt,
};
pub use crate::file::candidate::{Candidate, CandidateEntry, CandidateParameter, Candidates};
pub use crate::file::channel::{Channel, ChannelKind, EffectEntry, Operating, whole_turn};
pub use crate::file::document::ModelDocument;
pub use crate::file::equations::{
    EquationsFile, GroupEntry, GroupKind, ParameterEntry, StateEntry,
};
pub use crate::file::lti::{ModelFile, State};
pub use crate::file::nuisance::NuisanceEntry;
pub use crate::riccati::continuous::{care, lqr};
pub use crate::riccati::discrete::{dare, dlqr, gdare};
pub use crate::riccati::filter::{Filter, dlqe, lqe};
pub use crate::riccati::regulator::Lqr;
pub use d2c::{D2c, d2c, d2c_by};
pub use derived::{Derived, DerivedError};
pub use error::{Error, ModelError, Result};
pub use hinf::Peak;
pub use interconnection::{feedback, parallel, series};
pub use lyapunov::{dlyap, lyap};
pub use nu_gap::{NuGap, nu_gap};
pub use pade::pade;

pub use state_space::{Continuous, Sampled, StateSpace, TimeDomain};
pub use transfer_function::TransferFunction;

pub use deadtime_signal::decompositions::eigenvalues as iterated_eigenvalues;
pub use matrices::Matrices as Linearisation;
pub use matrix::exp;
