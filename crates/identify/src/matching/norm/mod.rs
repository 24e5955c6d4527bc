//! By what two responses are compared: one file a norm, one line each in [`NORMS`].

pub(crate) mod criterion;
mod h2;
mod hinf;
pub(crate) mod norms;
mod nu_gap;
mod wls;
