//! Topics out of named arrays and structs, as MATLAB and Simulink save them.

use super::error::Error;
use super::numbers::Numbers;
use super::options::{ReadOptions, TimeUnit};
use super::recording::{Recording, Table};
use crate::csv::clock::{Times, seconds};
use crate::csv::time_name::named_time;
use crate::notes::Notes;
use deadtime_signal::remedy::{Message, Remedy};

/// The content of a variable; arrays run column by column.
#[derive(Debug, Clone)]
pub(super) enum Array {
    Numbers {
        shape: Vec<usize>,
        values: Vec<f64>,
    },
    Text(String),
    Struct(Vec<(String, Array)>),
    /// Cells, or structs of the same fields.
    List(Vec<Array>),
    /// Stamps whose unit is known.
    Times {
        values: Vec<f64>,
        unit: TimeUnit,
    },
    /// A reference to an object of MATLAB.
    Object(Vec<f64>),
    Other,
}

/// Clocks with a larger difference than this have different epochs, s: ten years.
const ANOTHER_CLOCK_S: f64 = 3.2e8;

/// A vector of time with its channels.
struct Found<'a> {
    name: String,
    times: Times,
    columns: Vec<(String, &'a [f64])>,
}

/// The recording of a file's variables: arrays as long as a vector of time are its channels, structs with a time are topics.
pub(super) fn assemble(
    source: &str,
    format: &'static str,
    title: &'static str,
    variables: Vec<(String, Array)>,
    mut notes: Notes,
    options: &ReadOptions,
) -> Result<Recording, Error> {
    let mut found = Vec::new();
    collect("", &variables, &mut found, &mut notes, options);
    // The origin of one topic is that of the others, too.
    let origin_ns = found.iter().find_map(|found| found.times.origin_ns);
    let mut topics = Vec::new();
    for found in found {
        topics.extend(found.table(origin_ns).finish(source, &mut notes)?);
    }
    let numbers = |(_, array): &(String, Array)| {
        matches!(array, Array::Numbers { .. } | Array::Struct(_) | Array::List(_))
    };
    if topics.is_empty() && variables.iter().any(numbers) {
        let missing = "no vector of time was found: call one `time` or `t`, or name it with ";
        notes.push(Message::from(missing).and(Remedy::TimeColumn));
    }
    Recording::of_topics(source, (format, title), topics, notes)
}

impl Found<'_> {
    /// Its rows, their time counted from an origin of the whole file.
    fn table(&self, origin_ns: Option<i128>) -> Table {
        let mut table = Table::new(self.name.as_str());
        let places: Vec<usize> =
            self.columns.iter().map(|(column, _)| table.column(column.clone(), None)).collect();
        let apart_ns =
            origin_ns.map_or(0, |origin| self.times.origin_ns.unwrap_or(0).saturating_sub(origin));
        let mut later_s = apart_ns as f64 / 1e9;
        if (self.times.time_s.first().copied().unwrap_or(0.0) + later_s).abs() > ANOTHER_CLOCK_S {
            later_s = 0.0;
        }
        table.rows(|times| times.extend(self.times.time_s.iter().map(|stamp| stamp + later_s)));
        let rows = table.len();
        for (place, (_, values)) in places.iter().zip(&self.columns) {
            // A row without a number is missing.
            let values = values.iter().copied().chain(std::iter::repeat(f64::NAN)).take(rows);
            table.extend(*place, |column| *column = Numbers::F64(values.collect()));
        }
        table
    }
}

fn collect<'a>(
    name: &str,
    fields: &'a [(String, Array)],
    found: &mut Vec<Found<'a>>,
    notes: &mut Notes,
    options: &ReadOptions,
) {
    let vectors = || {
        fields.iter().filter_map(|(field, array)| {
            vector(array).map(|(values, unit)| (field.as_str(), values, unit))
        })
    };
    let stamps = || vectors().find(|(_, _, unit)| unit.is_some());
    let time = match &options.time {
        Some(wanted) => vectors().find(|(field, ..)| field == wanted).or_else(stamps),
        None => vectors()
            .find(|(field, ..)| *field == "time")
            .or_else(|| {
                vectors().find(|(field, ..)| {
                    named_time(field).is_some()
                        || matches!(field.to_lowercase().as_str(), "t" | "tout")
                })
            })
            .or_else(stamps),
    };
    if let Some((clock, stamps, unit)) = time {
        let known = options.time_unit.or(unit).or_else(|| named_time(clock).flatten());
        let plain = matches!(clock, "time" | "t" | "tout");
        let times =
            seconds(stamps.iter().map(f64::to_string), known, if plain { "time" } else { clock });
        if !plain || times.unit != TimeUnit::S || !times.note.is_empty() {
            notes.push(
                Message::from(format!(
                    "{}time is `{clock}`, in {}",
                    prefix(name),
                    times.unit.words()
                ))
                .and(times.note.clone()),
            );
        }
        let mut columns: Vec<(String, &[f64])> = Vec::new();
        for (field, array) in fields.iter().filter(|(field, _)| field != clock) {
            channels(field, array, stamps.len(), &mut columns, notes);
        }
        found.push(Found { name: name.to_owned(), times, columns });
    }
    for (field, array) in fields {
        let path = if name.is_empty() { field.clone() } else { format!("{name}.{field}") };
        nested(&path, array, found, notes, options);
    }
}

/// Structs within structs, and in cells by their number.
fn nested<'a>(
    path: &str,
    array: &'a Array,
    found: &mut Vec<Found<'a>>,
    notes: &mut Notes,
    options: &ReadOptions,
) {
    match array {
        Array::Struct(inner) => collect(path, inner, found, notes, options),
        Array::List(elements) => {
            for (k, element) in elements.iter().enumerate() {
                nested(&format!("{path}[{}]", k + 1), element, found, notes, options);
            }
        }
        _ => {}
    }
}

fn prefix(name: &str) -> String {
    if name.is_empty() { String::new() } else { format!("{name}: ") }
}

/// A row or column of at least two numbers, and their unit where they are stamps.
fn vector(array: &Array) -> Option<(&[f64], Option<TimeUnit>)> {
    match array {
        Array::Numbers { shape, values }
            if values.len() > 1 && shape.iter().filter(|n| **n > 1).count() == 1 =>
        {
            Some((values, None))
        }
        Array::Times { values, unit } if values.len() > 1 => Some((values, Some(*unit))),
        _ => None,
    }
}

/// The columns of an array that has one value, or several, a time stamp.
fn channels<'a>(
    field: &str,
    array: &'a Array,
    rows: usize,
    columns: &mut Vec<(String, &'a [f64])>,
    notes: &mut Notes,
) {
    match array {
        Array::Numbers { values, .. } if values.len() == rows => {
            columns.push((field.to_owned(), values))
        }
        // Time runs along the first dimension.
        Array::Numbers { shape, values } if shape.first() == Some(&rows) && rows > 0 => {
            let parts = values.chunks(rows).enumerate();
            columns.extend(parts.map(|(i, part)| (format!("{field}[{i}]"), part)));
        }
        Array::Numbers { values, shape } if values.len() > 1 => {
            let size: Vec<String> = shape.iter().map(ToString::to_string).collect();
            notes.push(format!(
                "{field}: {} values where time has {rows}; left out",
                size.join(" by ")
            ));
        }
        // Simulink's structure with time.
        Array::Struct(_) | Array::List(_) if field == "signals" => {
            let signals = match array {
                Array::List(signals) => signals.as_slice(),
                one => std::slice::from_ref(one),
            };
            for (i, signal) in signals.iter().enumerate() {
                let Array::Struct(parts) = signal else { continue };
                let part = |name: &str| {
                    parts.iter().find(|(field, _)| field == name).map(|(_, array)| array)
                };
                let label = match (part("label"), part("blockName")) {
                    (Some(Array::Text(label)), _) if !label.trim().is_empty() => {
                        label.trim().to_owned()
                    }
                    (_, Some(Array::Text(block))) if !block.trim().is_empty() => {
                        block.trim().replace('/', ".")
                    }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn vector_of(values: &[f64]) -> Array {
        Array::Numbers { shape: vec![values.len(), 1], values: values.to_vec() }
    }

    /// `time` from a start on in steps, and a channel of the same length.
    fn timed(name: &str, start: f64, step: f64) -> Vec<(String, Array)> {
        let stamps: Vec<f64> = (0..5).map(|k| start + step * f64::from(k)).collect();
        vec![
            ("time".to_owned(), vector_of(&stamps)),
            (name.to_owned(), vector_of(&[1.0, 2.0, 3.0, 4.0, 5.0])),
        ]
    }

    fn read(variables: Vec<(String, Array)>, options: &ReadOptions) -> Recording {
        assemble("a.mat", "mat", "MAT 5", variables, crate::notes::Notes::default(), options)
            .unwrap()
    }

    #[test]
    fn the_unit_of_time_is_told_by_the_size_of_whole_numbers_and_said() {
        let found = |variables, options: &ReadOptions| {
            let recording = read(variables, options);
            (recording.topics[0].log.time_s().to_vec(), recording.notes.join("|"))
        };
        let none = ReadOptions::default();
        let (time_s, notes) = found(timed("u", 0.0, 10_000.0), &none);
        assert_eq!(time_s, [0.0, 0.01, 0.02, 0.03, 0.04]);
        assert!(
            notes.contains("`time`, in microseconds by the size of its numbers; `time_unit`"),
            "{notes}"
        );
        let (time_s, notes) = found(timed("u", 1.7e15, 10_000.0), &none);
        assert_eq!(time_s, [0.0, 0.01, 0.02, 0.03, 0.04]);
        assert!(notes.contains("counted from the first (1700000000000000)"), "{notes}");
        assert_eq!(
            found(timed("u", 0.0, 0.5), &none),
            (vec![0.0, 0.5, 1.0, 1.5, 2.0], String::new())
        );
        let seconds = ReadOptions { time_unit: Some(TimeUnit::S), ..none };
        assert_eq!(found(timed("u", 0.0, 10_000.0), &seconds).0[1], 10_000.0);
    }

    #[test]
    fn topics_of_a_file_count_from_one_origin() {
        // Nanoseconds since a machine was switched on: one topic begins before 100 s, the other behind.
        let topic = |start: f64| Array::Struct(timed("u", start, 1e7));
        let recording = read(
            vec![("a".to_owned(), topic(1.002e11)), ("b".to_owned(), topic(9.99e10))],
            &ReadOptions::default(),
        );
        let starts: Vec<f64> = recording.topics.iter().map(|topic| topic.log.time_s()[0]).collect();
        assert!(starts[0] == 0.0 && (starts[1] + 0.3).abs() < 1e-9, "{starts:?}");
    }
}
