//! What the tests share.

// Which helpers are used differs from feature set to feature set.
#![allow(dead_code)]

pub(crate) mod blind;
pub(crate) mod compare;
pub(crate) mod coverage;
pub(crate) mod drawn;
pub(crate) mod outside;
pub(crate) mod plants;
#[cfg(feature = "cli")]
pub(crate) mod program;
pub(crate) mod schema;
