//! State-space models from records of several inputs and outputs: one file per method, one line each in `IDENTIFIERS` of the crate that searches for delays.
//!
//! Every method computes states as combinations of the past. A, B, C, D and K follow by two regressions (`innovations`), or by shifts and a free run (`moesp`).

mod bootstrap;
pub(crate) mod identifier;
pub(crate) mod innovations;
mod moesp;
mod n4sid;
mod offset;
pub(crate) mod order;
mod pbsidopt;
pub(crate) mod recordings;
mod search;
pub(crate) mod single;
pub(crate) mod uncertainty;
mod validation;

pub use identifier::{
    Identified, Identifier, IdentifierLine, MOESP, Moesp, N4SID, N4sid, PBSIDOPT, Pbsidopt,
    Settings,
};
pub use innovations::{Direct, InnovationsModel};
pub use order::{Candidate, OrderChoice, Sure};
pub use recordings::{Named, Recordings, Scales, Stretch};
pub use single::{Innovations, Subspace};
pub use uncertainty::{Band, Draws, Ellipse, Response, Root};
pub use validation::{Fit, InputTest, OutputCheck, Test};
