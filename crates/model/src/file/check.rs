//! Checks that model files of all kinds share.

use super::channel::{Channel, ChannelKind, Operating};
use crate::error::ModelError;
use std::path::Path;

/// No more states, inputs, outputs and parameters than a model may have: before anything is compared with anything.
pub(super) fn check_sizes(
    path: &Path,
    [inputs, states, parameters, outputs]: [usize; 4],
) -> std::result::Result<(), ModelError> {
    let wrong = |source| ModelError::Equations { path: path.to_owned(), source: Box::new(source) };
    crate::equations::system::check_sizes(inputs, states, parameters, outputs).map_err(wrong)
}

/// No name twice.
pub(super) fn check_names(
    path: &Path,
    what: &'static str,
    names: &[&str],
) -> std::result::Result<(), ModelError> {
    match names.iter().enumerate().find(|(i, n)| names.iter().take(*i).any(|before| before == *n)) {
        Some((_, name)) => {
            Err(ModelError::Duplicate { path: path.to_owned(), what, name: (*name).to_owned() })
        }
        None => Ok(()),
    }
}

/// Inputs and outputs: no name twice, finite operating points.
pub(super) fn check_channels(
    path: &Path,
    inputs: &[Channel],
    outputs: &[Channel],
) -> std::result::Result<(), ModelError> {
    for (what, channels) in [("input", inputs), ("output", outputs)] {
        check_names(path, what, &channels.iter().map(|c| c.name.as_str()).collect::<Vec<_>>())?;
    }
    let operating = inputs.iter().chain(outputs).find_map(|c| match c.operating {
        Operating::Value(v) if !v.is_finite() => Some(v),
        _ => None,
    });
    if let Some(value) = operating {
        return Err(ModelError::Number {
            path: path.to_owned(),
            key: "operating",
            value,
            rule: "it must be finite",
        });
    }
    match inputs
        .iter()
        .chain(outputs)
        .find(|c| c.kind == Some(ChannelKind::Angle) && c.turn().is_none())
    {
        Some(channel) => Err(ModelError::Unmatched {
            path: path.to_owned(),
            what: "the angle",
            name: channel.name.clone(),
            lacks: "needs its unit, `rad` or `deg`, to know what a whole turn is",
        }),
        None => Ok(()),
    }
}

/// Which numbers a list may hold.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Sign {
    Any,
    NotNegative,
}

/// A list that may be absent, else has its length and finite numbers.
pub(super) fn check_list(
    path: &Path,
    key: &'static str,
    list: &[f64],
    needed: usize,
    sign: Sign,
) -> std::result::Result<(), ModelError> {
    if !list.is_empty() && list.len() != needed {
        let detail = ModelError::Count { what: key, needed, got: list.len() }.to_string();
        return Err(ModelError::File { path: path.to_owned(), detail });
    }
    let positive = sign == Sign::NotNegative;
    match list.iter().find(|v| !v.is_finite() || (positive && **v < 0.0)) {
        Some(&value) => {
            let rule =
                if positive { "it must be finite and not negative" } else { "it must be finite" };
            Err(ModelError::Number { path: path.to_owned(), key, value, rule })
        }
        None => Ok(()),
    }
}
