//! The text of a model file.

use crate::error::{ModelError, Result};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::Path;

pub(super) const FORMAT: &str = "deadtime/model@1";

/// The valid values of `kind`.
pub(super) const KINDS: &str = "lti, equations, tf and zpk";

#[derive(Clone, Copy)]
pub(super) enum Syntax {
    Toml,
    Json,
}

pub(super) fn syntax(path: &Path) -> Result<Syntax, ModelError> {
    if path.as_os_str() == deadtime_signal::file::STANDARD_OUTPUT {
        return Ok(Syntax::Toml);
    }
    match path.extension().and_then(|e| e.to_str()) {
        Some("toml") => Ok(Syntax::Toml),
        Some("json") => Ok(Syntax::Json),
        _ => Err(ModelError::Extension { path: path.to_owned() }),
    }
}

pub(super) fn read_text(path: &Path) -> Result<(String, Syntax)> {
    let syntax = syntax(path)?;
    let text = deadtime_signal::file::read_text(path)?;
    Ok((text, syntax))
}

pub(super) fn parse_text<T: DeserializeOwned>(
    text: &str,
    syntax: Syntax,
    path: &Path,
) -> Result<T, ModelError> {
    let wrong = |detail: String| ModelError::File { path: path.to_owned(), detail };
    match syntax {
        Syntax::Toml => toml::from_str(text).map_err(|e| wrong(e.to_string())),
        Syntax::Json => serde_json::from_str(text).map_err(|e| wrong(e.to_string())),
    }
}

pub(super) fn text<T: Serialize>(file: &T, syntax: Syntax) -> Result<String, String> {
    match syntax {
        Syntax::Toml => toml::to_string(file).map_err(|e| e.to_string()),
        Syntax::Json => {
            serde_json::to_string_pretty(file).map_err(|e| e.to_string()).map(|t| t + "\n")
        }
    }
}

pub(super) fn write_text<T: Serialize>(path: &Path, file: &T, syntax: Syntax) -> Result<()> {
    let text =
        text(file, syntax).map_err(|detail| ModelError::File { path: path.to_owned(), detail })?;
    Ok(deadtime_signal::file::write_atomic(path, |out| out.write_all(text.as_bytes()))?)
}

/// The keys that define the format of the file.
#[derive(Deserialize)]
pub(super) struct Header {
    format: Option<String>,
    kind: Option<String>,
}

/// The file's kind, `lti`, `equations`, `tf` or `zpk`; checks that its format is that of this version.
pub(super) fn kind(text: &str, syntax: Syntax, path: &Path) -> Result<String, ModelError> {
    let Header { format, kind } = parse_text(text, syntax, path)?;
    let wrong = |key, found: Option<String>, known| {
        let found = found.unwrap_or_else(|| "missing".to_owned());
        ModelError::Kind { path: path.to_owned(), key, found, known }
    };
    if format.as_deref() != Some(FORMAT) {
        return Err(wrong("format", format, FORMAT));
    }
    match kind {
        Some(kind) if ["lti", "equations", "tf", "zpk"].contains(&kind.as_str()) => Ok(kind),
        kind => Err(wrong("kind", kind, KINDS)),
    }
}
