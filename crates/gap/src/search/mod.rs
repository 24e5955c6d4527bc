//! The search through the catalogue: a screen, single effects, several at once.

pub(crate) mod catalogue;
pub(crate) mod catalogue_search;
mod elaborations;
pub(crate) mod given_first;
pub(crate) mod late;
pub(crate) mod longer;
pub(crate) mod moving;
pub(crate) mod screen;
pub(crate) mod several;
pub(crate) mod singles;
pub(crate) mod slower_loop;
