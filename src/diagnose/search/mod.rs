//! The search through the catalogue: a screen, single effects, several at once.

pub(in crate::diagnose) mod beside;
pub(in crate::diagnose) mod catalogue;
pub(in crate::diagnose) mod catalogue_search;
mod elaborations;
pub(in crate::diagnose) mod late;
pub(in crate::diagnose) mod longer;
pub(in crate::diagnose) mod moving;
pub(in crate::diagnose) mod screen;
pub(in crate::diagnose) mod several;
pub(in crate::diagnose) mod singles;
pub(in crate::diagnose) mod slower_loop;
