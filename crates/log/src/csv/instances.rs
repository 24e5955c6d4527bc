//! Rows of several instances that take turns in one table, as loggers write two sensors of a kind.
//!
//! How it can be wrong: a column of the parity of the row number separates rows as well as a number of an instance does. The remedy names the column.

use std::collections::BTreeMap;

use super::cell::shown;
use super::clock::StampReader;
use super::header::Header;
use super::lines::Lines;
use crate::error::LogError;

/// Rows of the test.
const ROWS: usize = 500;
/// Values that the column of an instance has at most.
const MOST: usize = 16;
/// Rows of each instance.
const LEAST: usize = 3;

/// The error of a row whose time does not follow; where a column separates the rows below it into increasing ones, the column is named.
pub(super) fn instances(
    error: LogError,
    source: &str,
    lines: &mut Lines<'_>,
    header: &Header,
) -> LogError {
    if !matches!(error, LogError::TimeStandsStill { .. } | LogError::TimeRunsBack { .. }) {
        return error;
    }
    let row = lines.row;
    let mut stamps = StampReader::default();
    let (mut time, mut cells) = (Vec::new(), vec![Vec::new(); header.columns.len()]);
    while let Ok(raw) = header.stamp(source, lines, &mut stamps) {
        time.push(raw);
        for (column, (place, ..)) in cells.iter_mut().zip(&header.columns) {
            column.push(lines.cell(*place).trim_ascii().to_vec());
        }
        if time.len() >= ROWS || !lines.next().unwrap_or(false) {
            break;
        }
    }
    let columns = cells.iter().zip(&header.columns);
    let found = columns.filter_map(|(cells, (_, name, _))| Some((name, separated(&time, cells)?)));
    match found.min_by_key(|(_, values)| values.len()) {
        Some((column, values)) => LogError::Instances {
            file: source.to_owned(),
            row,
            column: column.clone(),
            values: values.iter().map(|value| shown(value)).collect(),
        },
        None => error,
    }
}

/// The values of a column by which times increase, where they take turns.
fn separated(time: &[f64], cells: &[Vec<u8>]) -> Option<Vec<Vec<u8>>> {
    // One row out of order takes no turns: any column separates what increases anyway. A column that changes in every row takes turns, however few stamps meet.
    let returns =
        time.iter().zip(time.iter().skip(1)).filter(|(before, after)| after <= before).count();
    let takes_turns = cells.iter().zip(cells.iter().skip(1)).all(|(before, after)| before != after);
    if returns < LEAST && !takes_turns {
        return None;
    }
    let mut last: BTreeMap<&[u8], (f64, usize)> = BTreeMap::new();
    for (time, cell) in time.iter().zip(cells) {
        match last.get_mut(cell.as_slice()) {
            Some((before, count)) if *before < *time => (*before, *count) = (*time, *count + 1),
            Some(_) => return None,
            None => {
                last.insert(cell, (*time, 1));
            }
        }
        if last.len() > MOST {
            return None;
        }
    }
    let often = last.values().all(|(_, count)| *count >= LEAST);
    let named = last.keys().all(|cell| !cell.is_empty());
    (last.len() > 1 && often && named).then(|| last.keys().map(|cell| cell.to_vec()).collect())
}

#[cfg(test)]
mod tests {
    use crate::csv::table::recording_from;
    use crate::options::ReadOptions;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn instances_that_take_turns_are_named_and_one_of_them_is_read() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(31);
        for round in 0..60 {
            let count = rng.random_range(2..5_usize);
            let text_names = round % 2 == 0;
            let name = |i: usize| if text_names { format!("imu{i}") } else { i.to_string() };
            let jitter = rng.random_bool(0.5);
            let mut text = "TimeUS,I,acc\n".to_owned();
            for k in 0..80 {
                for i in 0..count {
                    let late = if jitter { rng.random_range(0..900) * i } else { 0 };
                    text += &format!("{},{},{}\n", 10_000 * k + late / count, name(i), 10 * k + i);
                }
            }
            let options = ReadOptions { time: Some("TimeUS".into()), ..ReadOptions::default() };
            let said = recording_from("a.csv", text.as_bytes(), &options).map(|r| r.notes);
            // Stamps that happen to increase throughout are a log.
            if let Err(said) = said {
                let said = said.to_string();
                assert!(said.contains("by the column `I`") && said.contains(&name(0)), "{said}");
            } else {
                assert!(jitter, "{text}");
            }
            let pick = rng.random_range(0..count);
            let options = ReadOptions { only: Some(("I".into(), name(pick))), ..options };
            let log =
                recording_from("a.csv", text.as_bytes(), &options).unwrap().into_log().unwrap();
            let acc = log.input("acc").unwrap();
            assert!(
                acc.len() == 80 && acc.iter().zip(0..).all(|(a, k)| *a == (10 * k + pick) as f64)
            );
            let none = ReadOptions { only: Some(("I".into(), "nine".into())), ..options };
            let said = recording_from("a.csv", text.as_bytes(), &none).unwrap_err().to_string();
            assert!(said.contains("no row has `nine`") && said.contains(&name(1)), "{said}");
        }
    }
}
