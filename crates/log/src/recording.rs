//! The content of a file before any choice of channels: topics, each with its own stamps.

use std::collections::HashSet;

use super::budget::Budget;
use super::channels::{Channel, Log, Origin, Rows, TIME_LIMIT_S};
use super::error::{Error, LogError};
use super::numbers::Numbers;
use super::place::neighbours;
use crate::notes::Notes;

/// A file after reading: its topics and the notes of the reading.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// The file as it was given.
    pub source: String,
    /// The name of its format.
    pub format: &'static str,
    /// Its topics, in the file's order.
    pub topics: Vec<Topic>,
    /// Guesses, omissions and truncations, a sentence each.
    pub notes: Notes,
}

/// Channels that share their time stamps.
#[derive(Debug, Clone, PartialEq)]
pub struct Topic {
    /// Its name; empty where the file has no topics.
    pub name: String,
    /// Its samples.
    pub log: Log,
}

impl Recording {
    /// A file without topics.
    pub(super) fn single(format: &'static str, log: Log, notes: Notes) -> Self {
        Self {
            source: log.source.clone(),
            format,
            topics: vec![Topic { name: String::new(), log }],
            notes,
        }
    }

    /// A file of topics by the name of its format and what that is called; one topic at least.
    pub(super) fn of_topics(
        source: &str,
        (format, title): (&'static str, &'static str),
        topics: Vec<Topic>,
        notes: Notes,
    ) -> Result<Self, Error> {
        let source = source.to_owned();
        if topics.is_empty() {
            return Err(LogError::NoTopics { file: source, format: title, notes }.into());
        }
        Ok(Self { source, format, topics, notes })
    }

    /// The log of a file that has one topic.
    ///
    /// # Errors
    /// [`LogError::SeveralTopics`].
    pub fn into_log(self) -> Result<Log, LogError> {
        let names = || self.topics.iter().map(|t| t.name.clone()).collect();
        let error = LogError::SeveralTopics { file: self.source.clone(), topics: names() };
        let mut topics = self.topics.into_iter();
        match (topics.next(), topics.next()) {
            (Some(only), None) => Ok(only.log),
            _ => Err(error),
        }
    }
}

/// Bytes that a number of a table takes, with whether it is there.
const CELL: u64 = 9;

/// A topic during the reading: rows of numbers, in any order of their stamps.
#[derive(Debug, Clone, Default)]
pub(super) struct Table {
    name: String,
    time_s: Vec<f64>,
    columns: Vec<TableColumn>,
    endless: usize,
    budget: Budget,
}

#[derive(Debug, Clone)]
struct TableColumn {
    name: String,
    unit: Option<String>,
    values: Numbers,
    present: Option<Vec<bool>>,
}

impl TableColumn {
    fn set(&mut self, row: usize, value: Option<f64>, budget: &Budget) {
        // A row has one value a column.
        let Some(added) = (row + 1).checked_sub(self.values.len()).filter(|n| *n > 0) else {
            return;
        };
        if !budget.take(CELL * added as u64) {
            return;
        }
        if self.values.len() < row || value.is_none() {
            self.present.get_or_insert_with(|| vec![true; self.values.len()]);
        }
        self.values.resize(row);
        self.values.push(value.unwrap_or(0.0));
        if let Some(present) = &mut self.present {
            present.resize(row, false);
            present.push(value.is_some());
        }
    }
}

impl Table {
    pub(super) fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), ..Self::default() }
    }

    /// The same within a budget: nothing is added to it beyond.
    pub(super) fn within(self, budget: &Budget) -> Self {
        Self { budget: budget.clone(), ..self }
    }

    /// Its name.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// The number of a column.
    pub(super) fn place(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.name == name)
    }

    /// A column's value in the row that was begun last.
    pub(super) fn last(&self, column: usize) -> Option<f64> {
        let row = self.time_s.len().checked_sub(1)?;
        let column = self.columns.get(column)?;
        let there = column.present.as_ref().is_none_or(|p| p.get(row).copied().unwrap_or(false));
        if there { column.values.get(row) } else { None }
    }

    /// Gives the row that was begun last another time stamp.
    pub(super) fn restamp(&mut self, time_s: f64) {
        if let Some(last) = self.time_s.last_mut() {
            *last = time_s;
        }
    }

    /// Takes back the row that was begun last.
    pub(super) fn drop_row(&mut self) {
        let mut back = u64::from(self.time_s.pop().is_some());
        let rows = self.time_s.len();
        for column in &mut self.columns {
            if column.values.len() > rows {
                back += (column.values.len() - rows) as u64;
                column.values.resize(rows);
            }
            if let Some(present) = &mut column.present {
                present.truncate(rows);
            }
        }
        self.budget.give(CELL * back);
    }

    /// Gives it another name.
    pub(super) fn rename(&mut self, name: String) {
        self.name = name;
    }

    /// Adds a column and gives its number.
    pub(super) fn column(&mut self, name: impl Into<String>, unit: Option<&str>) -> usize {
        self.column_of(name, unit, Numbers::F64(Vec::new()))
    }

    /// Adds a column whose numbers have the type of `empty` in the file, and gives its number.
    pub(super) fn column_of(
        &mut self,
        name: impl Into<String>,
        unit: Option<&str>,
        empty: Numbers,
    ) -> usize {
        self.columns.push(TableColumn {
            name: name.into(),
            unit: unit.map(Into::into),
            values: empty,
            present: None,
        });
        self.columns.len() - 1
    }

    /// Begins a row.
    pub(super) fn row(&mut self, time_s: f64) {
        if self.budget.take(CELL) {
            self.time_s.push(time_s);
        }
    }

    /// Begins several rows.
    pub(super) fn rows(&mut self, times: impl FnOnce(&mut Vec<f64>)) {
        times(&mut self.time_s);
    }

    /// Writes numbers into all begun rows in which the column has none yet; a number that is not finite is missing.
    pub(super) fn extend(&mut self, column: usize, numbers: impl FnOnce(&mut Numbers)) {
        let rows = self.time_s.len();
        let Some(column) = self.columns.get_mut(column) else { return };
        let before = column.values.len();
        numbers(&mut column.values);
        let added = column.values.len() - before;
        if before + added < rows {
            // Rows before these have no number: the new ones belong to the last rows.
            column.present.get_or_insert_with(|| vec![true; before]).resize(rows - added, false);
            column.values.move_to_end(before, rows);
        }
        let from = column.values.len() - added;
        let bad = column.values.not_finite(from);
        if bad.is_some() {
            column.present.get_or_insert_with(|| vec![true; from]);
        }
        let Some(present) = &mut column.present else { return };
        present.resize(from + added, true);
        for at in bad.into_iter().flat_map(|first| first..from + added) {
            let Some(value) = column.values.get(at).filter(|x| !x.is_finite()) else { continue };
            self.endless += usize::from(value.is_infinite());
            column.values.clear(at);
            if let Some(there) = present.get_mut(at) {
                *there = false;
            }
        }
    }

    /// The number of rows.
    pub(super) fn len(&self) -> usize {
        self.time_s.len()
    }

    /// Writes a number into the latest row. A number that is not finite is missing: autopilots log NaN for unset values.
    pub(super) fn set(&mut self, column: usize, value: f64) {
        let Some(row) = self.time_s.len().checked_sub(1) else { return };
        if value.is_infinite() {
            self.endless += 1;
        }
        if let Some(column) = self.columns.get_mut(column) {
            column.set(row, Some(value).filter(|v| v.is_finite()), &self.budget);
        }
    }

    /// The topic: rows in order of time, the first of rows with the same stamp, columns without a number left out; notes report the omissions. `None` when no
    /// row remains.
    pub(super) fn finish(
        mut self,
        source: &str,
        notes: &mut Notes,
    ) -> Result<Option<Topic>, LogError> {
        let rows = self.time_s.len();
        let missing: usize = self.columns.iter().map(|c| rows.saturating_sub(c.values.len())).sum();
        self.budget.take(CELL * missing as u64);
        self.budget.check(source)?;
        let what = if self.name.is_empty() { String::new() } else { format!("{}: ", self.name) };
        for column in &mut self.columns {
            if column.values.len() < rows {
                column.present.get_or_insert_with(|| vec![true; column.values.len()]);
                column.values.resize(rows);
                if let Some(present) = &mut column.present {
                    present.resize(rows, false);
                }
            }
        }
        if self.endless > 0 {
            notes.push(format!("{what}{} infinite values count as missing", self.endless));
        }
        self.sort(&what, notes);
        if self.time_s.is_empty() {
            return Ok(None);
        }
        let mut seen = HashSet::new();
        let mut channels = Vec::with_capacity(self.columns.len());
        for TableColumn { name, unit, values, present } in self.columns {
            let there = present.as_ref().is_none_or(|p| p.iter().any(|x| *x));
            let name = header(&name);
            if there && seen.insert(name.clone()) {
                channels.push(Channel { name, unit, values: values.into(), present });
            }
        }
        if channels.is_empty() {
            return Ok(None);
        }
        let source = if self.name.is_empty() {
            source.to_owned()
        } else {
            format!("{source}:{}", self.name)
        };
        let log =
            Log::assemble(source, self.time_s, channels, Vec::new(), Rows::new(Origin::Memory))?;
        Ok(Some(Topic { name: self.name, log }))
    }
    /// Puts the rows in the order of time; of those with the same stamp the first stays.
    fn sort(&mut self, what: &str, notes: &mut Notes) {
        let rows = self.time_s.len();
        let usable = |t: &f64| t.is_finite() && t.abs() <= TIME_LIMIT_S;
        if self.time_s.iter().all(usable)
            && neighbours(&self.time_s).all(|(before, after)| before < after)
        {
            return;
        }
        let mut order: Vec<usize> =
            (0..rows).filter(|&i| self.time_s.get(i).is_some_and(usable)).collect();
        let at = |i: usize| self.time_s.get(i).copied().unwrap_or(0.0);
        let back = neighbours(&order).filter(|(before, after)| at(*after) < at(*before)).count();
        order.sort_by(|&a, &b| at(a).total_cmp(&at(b)));
        order.dedup_by(|b, a| at(*a) == at(*b));
        if order.len() < rows {
            notes.push(format!(
                "{what}{} of {rows} samples have the time stamp of another one, or none, and are left out",
                rows - order.len()
            ));
        }
        if back > 0 {
            notes.push(format!("{what}time runs back {back} times; its samples are put in order"));
        }
        self.time_s = order.iter().map(|&i| at(i)).collect();
        for column in &mut self.columns {
            column.values = column.values.picked(&order);
            let there =
                |p: &Vec<bool>| order.iter().map(|&i| p.get(i).copied().unwrap_or(false)).collect();
            column.present = column.present.as_ref().map(there);
        }
    }
}

/// Names come from files: what cannot be a header is made one.
fn header(name: &str) -> String {
    let name: String = name.chars().filter(|c| !c.is_control()).collect();
    match name.trim() {
        bare @ ("" | "time") => format!("{bare}_"),
        bare => bare.to_owned(),
    }
}
