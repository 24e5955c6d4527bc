//! Topics out of named arrays and structs, as MATLAB and Simulink save them.

use super::csv::named_time;
use super::recording::{ReadOptions, Recording, Table, TimeUnit};
use super::{LogError, Topic};
use crate::error::Error;

/// What a variable holds; arrays run column by column.
#[derive(Debug, Clone)]
pub(super) enum Array {
    Numbers { shape: Vec<usize>, values: Vec<f64> },
    Text(String),
    Struct(Vec<(String, Array)>),
    List(Vec<Array>),
    Other,
}

/// The recording of a file's variables: arrays as long as a vector of time beside them are its channels, structs with a time are topics.
pub(super) fn assemble(
    source: &str,
    format: &'static str,
    title: &'static str,
    variables: Vec<(String, Array)>,
    mut notes: Vec<String>,
    options: &ReadOptions,
) -> Result<Recording, Error> {
    let mut topics = Vec::new();
    collect(source, "", &variables, &mut topics, &mut notes, options)?;
    if topics.is_empty() {
        if variables.iter().any(|(_, array)| matches!(array, Array::Numbers { .. } | Array::Struct(_))) {
            notes.push("no vector of time was found: call one `time` or `t`, or name it with --time".into());
        }
        return Err(LogError::NoTopics { file: source.into(), format: title, notes }.into());
    }
    Ok(Recording { source: source.into(), format, topics, notes })
}

fn collect(
    source: &str,
    name: &str,
    fields: &[(String, Array)],
    topics: &mut Vec<Topic>,
    notes: &mut Vec<String>,
    options: &ReadOptions,
) -> Result<(), Error> {
    let vectors = || fields.iter().filter_map(|(field, array)| vector(array).map(|values| (field.as_str(), values)));
    let time = match &options.time {
        Some(wanted) => vectors().find(|(field, _)| field == wanted),
        None => vectors()
            .find(|(field, _)| *field == "time")
            .or_else(|| vectors().find(|(field, _)| named_time(field).is_some() || matches!(field.to_lowercase().as_str(), "t" | "tout"))),
    };
    if let Some((clock, stamps)) = time {
        let unit = options.time_unit.or_else(|| named_time(clock).flatten()).unwrap_or(TimeUnit::S);
        if !matches!(clock, "time" | "t" | "tout") || unit != TimeUnit::S {
            notes.push(format!("{}time is `{clock}`, in {}", prefix(name), unit.words()));
        }
        let mut columns: Vec<(String, &[f64])> = Vec::new();
        for (field, array) in fields.iter().filter(|(field, _)| field != clock) {
            channels(field, array, stamps.len(), &mut columns, notes);
        }
        let mut table = Table::new(name);
        let places: Vec<usize> = columns.iter().map(|(column, _)| table.column(column.clone(), None)).collect();
        for (row, stamp) in stamps.iter().enumerate() {
            table.row(stamp / unit.per_second());
            for (place, (_, values)) in places.iter().zip(&columns) {
                if let Some(value) = values.get(row) {
                    table.set(*place, *value);
                }
            }
        }
        topics.extend(table.finish(source, notes)?);
    }
    for (field, array) in fields {
        let path = if name.is_empty() { field.clone() } else { format!("{name}.{field}") };
        if let Array::Struct(inner) = array {
            collect(source, &path, inner, topics, notes, options)?;
        }
    }
    Ok(())
}

fn prefix(name: &str) -> String {
    if name.is_empty() { String::new() } else { format!("{name}: ") }
}

/// A row or column of at least two numbers.
fn vector(array: &Array) -> Option<&[f64]> {
    match array {
        Array::Numbers { shape, values } if values.len() > 1 && shape.iter().filter(|n| **n > 1).count() == 1 => Some(values),
        _ => None,
    }
}

/// The columns of an array that has one value, or several, a time stamp.
fn channels<'a>(field: &str, array: &'a Array, rows: usize, columns: &mut Vec<(String, &'a [f64])>, notes: &mut Vec<String>) {
    match array {
        Array::Numbers { values, .. } if values.len() == rows => columns.push((field.to_owned(), values)),
        // Time runs along the first dimension.
        Array::Numbers { shape, values } if shape.first() == Some(&rows) && rows > 0 => {
            let parts = values.chunks(rows).enumerate();
            columns.extend(parts.map(|(i, part)| (format!("{field}[{i}]"), part)));
        }
        Array::Numbers { values, shape } if values.len() > 1 => {
            let size: Vec<String> = shape.iter().map(ToString::to_string).collect();
            notes.push(format!("{field}: {} values where time has {rows}; left out", size.join(" by ")));
        }
        // Simulink's structure with time.
        Array::Struct(_) | Array::List(_) if field == "signals" => {
            let signals = match array {
                Array::List(signals) => signals.as_slice(),
                one => std::slice::from_ref(one),
            };
            for (i, signal) in signals.iter().enumerate() {
                let Array::Struct(parts) = signal else { continue };
                let part = |name: &str| parts.iter().find(|(field, _)| field == name).map(|(_, array)| array);
                let label = match (part("label"), part("blockName")) {
                    (Some(Array::Text(label)), _) if !label.trim().is_empty() => label.trim().to_owned(),
                    (_, Some(Array::Text(block))) if !block.trim().is_empty() => block.trim().replace('/', "."),
                    _ => format!("signals[{i}]"),
                };
                if let Some(values) = part("values") {
                    channels(&label, values, rows, columns, notes);
                }
            }
        }
        _ => {}
    }
}
