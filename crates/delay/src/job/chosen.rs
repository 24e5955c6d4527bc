//! The methods of an estimation.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::error::{DelayError, Result};
use crate::estimator::DelayEstimator;
use crate::method::{Method, Scope};
use crate::methods::every;
use deadtime_signal::registry::RegistryError;

/// A method, ready to run.
pub struct Ready {
    /// Its line in the list.
    pub method: &'static Method,
    /// The method with its options.
    pub estimator: Box<dyn DelayEstimator>,
}

impl Ready {
    /// Every sample method, with its default options.
    #[must_use]
    pub fn all() -> Vec<Self> {
        Self::with(|scope| scope != Scope::Events)
    }

    /// Every method between event times, with its default options.
    #[must_use]
    pub fn of_events() -> Vec<Self> {
        Self::with(|scope| scope == Scope::Events)
    }

    fn with(scope: impl Fn(Scope) -> bool) -> Vec<Self> {
        every()
            .filter(|m| scope(m.scope))
            .filter_map(|method| Some(Self { method, estimator: method.entry.with(none()).ok()? }))
            .collect()
    }
}

/// The names of the methods for which a single step is enough.
pub const STEP_METHODS: [&str; 6] = ["p1d", "p2d", "p3d", "p2dz", "area1", "cusum_step"];

/// The requested methods in the list's order, with their options as JSON objects; `all` are those with one of `scopes`.
///
/// # Errors
/// [`RegistryError`] for an unknown name or option; [`DelayError::WrongScope`] for a method of another scope.
pub fn chosen(
    names: &[String],
    options: &BTreeMap<String, Value>,
    scopes: &[Scope],
) -> Result<Vec<Ready>> {
    known("method", every().map(|m| m.entry.name), names, options)?;
    let all = names.iter().any(|n| n == "all");
    let mut ready = Vec::new();
    for method in every() {
        let name = method.entry.name;
        let (named, events) = (names.iter().any(|n| n == name), method.scope == Scope::Events);
        if named && events != scopes.contains(&Scope::Events) {
            return Err(DelayError::WrongScope { method: name, events }.into());
        }
        if named || (all && scopes.contains(&method.scope)) {
            ready.push(Ready { method, estimator: method.entry.with(options_of(options, name))? });
        }
    }
    Ok(ready)
}

/// Checks that every requested name is one of `known`, or `all`.
pub(crate) fn known(
    kind: &'static str,
    known: impl Iterator<Item = &'static str>,
    names: &[String],
    options: &BTreeMap<String, Value>,
) -> Result<(), RegistryError> {
    let known: Vec<&'static str> = known.collect();
    let mut named = names.iter().filter(|n| *n != "all").chain(options.keys());
    match named.find(|n| !known.contains(&n.as_str())) {
        Some(name) => Err(RegistryError::Unknown { kind, name: name.clone(), known }),
        None => Ok(()),
    }
}

/// The options of the method called `name`; `null` without any.
pub(crate) fn options_of(options: &BTreeMap<String, Value>, name: &str) -> Value {
    options.get(name).cloned().unwrap_or_else(none)
}

fn none() -> Value {
    Value::Object(serde_json::Map::new())
}
