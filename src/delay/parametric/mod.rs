//! Sampled models of low order, the delay a parameter of theirs.

pub(super) mod arxstruc;
pub(super) mod oestruc;

pub use arxstruc::Arxstruc;
pub use oestruc::Oestruc;
