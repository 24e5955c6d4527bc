//! Headers of columns.

/// Splits a header `name [unit]` or `name`.
#[must_use]
pub fn name_and_unit(header: &str) -> (&str, Option<&str>) {
    let header = header.trim();
    match header.strip_suffix(']').and_then(|rest| rest.rsplit_once(" [")) {
        Some((name, unit)) if !unit.trim().is_empty() => (name.trim(), Some(unit.trim())),
        Some((name, _)) => (name.trim(), None),
        None => (header, None),
    }
}
