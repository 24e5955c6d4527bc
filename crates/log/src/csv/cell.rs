//! The content of one cell of a text table.

use super::number::decimal;
use crate::error::LogError;
use crate::place::Place;

/// As much of an offending cell as a message shows, in characters.
pub(super) const SHOWN: usize = 40;

/// Cells that mean a missing sample, in addition to empty ones and those that are read as NaN; lower case.
pub(super) const NOTHING: [&[u8]; 7] = [b"-", b"--", b"na", b"n/a", b"#n/a", b"null", b"none"];

/// The content of one cell.
pub(super) enum Cell {
    Number(f64),
    Missing,
    NotFinite,
    /// A comma that may be a decimal comma or a thousands separator.
    Comma,
    Text,
}

impl Cell {
    /// The number; `None` where it is missing.
    pub(super) fn number(
        self,
        file: &str,
        row: usize,
        channel: &str,
        cell: &[u8],
    ) -> Result<Option<f64>, LogError> {
        match self {
            Self::Number(x) => Ok(Some(x)),
            Self::Missing => Ok(None),
            other => Err(other.refusal(file, row, channel, cell)),
        }
    }

    /// The message on a cell without a number.
    pub(super) fn refusal(&self, file: &str, row: usize, channel: &str, cell: &[u8]) -> LogError {
        let (file, place, channel, text) =
            (file.to_owned(), Place::Row(row), channel.to_owned(), shown(cell));
        match self {
            Self::NotFinite => LogError::NotFinite { file, place, channel, text },
            Self::Comma => LogError::Comma { file, place, channel, text },
            Self::Number(_) | Self::Missing | Self::Text => {
                LogError::NotANumber { file, place, channel, text }
            }
        }
    }
}

/// A cell with one comma and no point, the comma made a point.
pub(super) fn with_point(text: &str) -> Option<String> {
    (text.bytes().filter(|byte| *byte == b',').count() == 1 && !text.contains('.'))
        .then(|| text.replace(',', "."))
}

/// Whether a comma may separate thousands: three digits behind it, one to three before it and no 0 in front.
pub(super) fn may_be_thousands(text: &str) -> bool {
    let digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    text.trim_start_matches(['-', '+']).split_once(',').is_some_and(|(whole, behind)| {
        digits(whole)
            && digits(behind)
            && behind.len() == 3
            && (1..=3).contains(&whole.len())
            && !whole.starts_with('0')
    })
}

/// Whether a cell is a number with a decimal comma beyond doubt.
pub(super) fn has_decimal_comma(cell: &[u8]) -> bool {
    cell.contains(&b',')
        && !std::str::from_utf8(cell).is_ok_and(may_be_thousands)
        && matches!(parse(cell, true), Cell::Number(_))
}

pub(super) fn parse(cell: &[u8], decimal_comma: bool) -> Cell {
    if cell.is_empty() {
        return Cell::Missing;
    }
    if let Some(x) = decimal(cell) {
        return Cell::Number(x);
    }
    let Ok(text) = std::str::from_utf8(cell) else { return Cell::Text };
    let number = match text.parse::<f64>() {
        Ok(x) => Some(x),
        Err(_) => match with_point(text).and_then(|t| t.parse().ok()) {
            Some(_) if !decimal_comma && may_be_thousands(text) => return Cell::Comma,
            x => x,
        },
    };
    match number {
        Some(x) if x.is_finite() => Cell::Number(x),
        Some(x) if x.is_nan() => Cell::Missing,
        Some(_) => Cell::NotFinite,
        None if NOTHING.contains(&text.to_lowercase().as_bytes()) => Cell::Missing,
        None if ON.iter().any(|on| text.eq_ignore_ascii_case(on)) => Cell::Number(1.0),
        None if OFF.iter().any(|off| text.eq_ignore_ascii_case(off)) => Cell::Number(0.0),
        None => Cell::Text,
    }
}

/// The words for 1 and for 0 in columns of switches.
const ON: [&str; 6] = ["true", "on", "yes", "high", "ein", "an"];
const OFF: [&str; 5] = ["false", "off", "no", "low", "aus"];

/// A cell as a message shows it.
pub(super) fn shown(cell: &[u8]) -> String {
    let text = String::from_utf8_lossy(cell);
    if text.chars().count() <= SHOWN {
        text.into_owned()
    } else {
        text.chars().take(SHOWN).chain(['…']).collect()
    }
}
