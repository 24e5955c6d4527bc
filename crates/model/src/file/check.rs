//! Checks shared by model files of all kinds.

use super::channel::{Channel, ChannelKind, Operating};
use crate::error::ModelError;
use std::path::Path;

const FINITE: &str = "it must be finite";

/// An item with a name that lacks a required part.
pub(super) fn unmatched(
    path: &Path,
    what: &'static str,
    name: &str,
    lacks: &'static str,
) -> ModelError {
    ModelError::Unmatched { path: path.to_owned(), what, name: name.to_owned(), lacks }
}

/// The error for an invalid value.
pub(super) fn number(path: &Path, key: &'static str, value: f64, rule: &'static str) -> ModelError {
    ModelError::Number { path: path.to_owned(), key, value, rule }
}

/// A valid sample time; 0 for continuous time.
pub(super) fn check_sample_time(path: &Path, sample_time_s: f64) -> Result<(), ModelError> {
    if sample_time_s.is_finite() && sample_time_s >= 0.0 {
        return Ok(());
    }
    let rule = "it must be above 0, or 0 for continuous time";
    Err(number(path, "sample_time_s", sample_time_s, rule))
}

/// The number of states, inputs, outputs and parameters is within the limits; checked before any comparison.
pub(super) fn check_sizes(
    path: &Path,
    [inputs, states, parameters, outputs]: [usize; 4],
) -> Result<(), ModelError> {
    let wrong = |source| ModelError::Equations { path: path.to_owned(), source: Box::new(source) };
    crate::equations::system::check_sizes(inputs, states, parameters, outputs).map_err(wrong)
}

/// Names are unique.
pub(super) fn check_names(
    path: &Path,
    what: &'static str,
    names: &[&str],
) -> Result<(), ModelError> {
    match names.iter().enumerate().find(|(i, n)| names.iter().take(*i).any(|before| before == *n)) {
        Some((_, name)) => {
            Err(ModelError::Duplicate { path: path.to_owned(), what, name: (*name).to_owned() })
        }
        None => Ok(()),
    }
}

/// Inputs and outputs: unique names, finite operating points.
pub(super) fn check_channels(
    path: &Path,
    inputs: &[Channel],
    outputs: &[Channel],
) -> Result<(), ModelError> {
    for (what, channels) in [("input", inputs), ("output", outputs)] {
        check_names(path, what, &channels.iter().map(|c| c.name.as_str()).collect::<Vec<_>>())?;
    }
    let operating = inputs.iter().chain(outputs).find_map(|c| match c.operating {
        Operating::Value(v) if !v.is_finite() => Some(v),
        _ => None,
    });
    if let Some(value) = operating {
        return Err(number(path, "operating", value, FINITE));
    }
    match inputs
        .iter()
        .chain(outputs)
        .find(|c| c.kind == Some(ChannelKind::Angle) && c.turn().is_none())
    {
        Some(channel) => {
            let lacks = "needs its unit, `rad` or `deg`, to know what a whole turn is";
            Err(unmatched(path, "the angle", &channel.name, lacks))
        }
        None => Ok(()),
    }
}

/// The sign allowed in a list.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Sign {
    Any,
    NotNegative,
}

/// A list that may be absent; otherwise of the right length, with finite values.
pub(super) fn check_list(
    path: &Path,
    key: &'static str,
    list: &[f64],
    needed: usize,
    sign: Sign,
) -> Result<(), ModelError> {
    if !list.is_empty() && list.len() != needed {
        let detail = ModelError::Count { what: key, needed, got: list.len() }.to_string();
        return Err(ModelError::File { path: path.to_owned(), detail });
    }
    let positive = sign == Sign::NotNegative;
    match list.iter().find(|v| !v.is_finite() || (positive && **v < 0.0)) {
        Some(&value) => {
            let rule = if positive { "it must be finite and not negative" } else { FINITE };
            Err(number(path, key, value, rule))
        }
        None => Ok(()),
    }
}
