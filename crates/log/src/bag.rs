//! Topics of bags (MCAP, rosbag2): messages of several encodings, stamped by the recorder or by their senders.

use deadtime_signal::remedy::{Message, Remedy};
use deadtime_signal::stats;
use std::collections::{BTreeMap, HashMap};

use serde_json::Value;

use super::budget::Budget;
use super::error::Error;
use super::options::{ReadOptions, Stamps};
use super::protobuf::Messages;
use super::recording::{Recording, Table, Topic};
use super::ros::{Decoder, Definitions, Encoding, MOST_ELEMENTS, Node};
use crate::notes::Notes;

/// How messages of a topic are written.
pub(super) struct Schema<'a> {
    /// The type's name.
    pub(super) name: &'a str,
    /// How the definition is written: `ros2msg`, `ros1msg`, `jsonschema`, ….
    pub(super) encoding: &'a str,
    /// The definition.
    pub(super) data: &'a [u8],
}

/// A bag while it is read.
pub(super) struct Bag {
    stamps: Stamps,
    /// The memory that all of it may take.
    pub(super) budget: Budget,
    /// Which file of several is read; numbers of channels are its own.
    part: u64,
    origin_ns: Option<i128>,
    streams: BTreeMap<u64, Stream>,
    /// Channels that go into the stream of another one: of several senders of one topic.
    same: HashMap<u64, u64>,
    pub(super) notes: Notes,
    /// Parts whose checksum does not match are read, too.
    pub(super) unchecked: bool,
    /// Messages of channels that no part of the file names.
    unknown: u64,
}

struct Stream {
    topic: String,
    /// Encoding and definition of its messages.
    kind: MessageKind,
    table: Table,
    how: How,
    messages: usize,
    broken: usize,
    /// The sender's stamp: its name, and its columns.
    header: Option<(&'static str, usize, usize)>,
    /// Recorder's stamp minus sender's, s.
    late_s: Vec<f64>,
}

/// How messages are encoded, and the name and text of their definition.
type MessageKind = (String, Option<(String, Vec<u8>)>);

enum How {
    Ros(Box<Decoder>),
    Protobuf(Box<Messages>),
    Json(HashMap<String, usize>),
    Unknown(String),
}

impl Stream {
    /// Says what of its messages is left out.
    fn left_out(&self, name: &str, notes: &mut Notes) {
        match &self.how {
            How::Unknown(why) if self.messages > 0 => {
                notes.push(format!("{name}: {why}; left out"));
            }
            _ if self.broken > 0 => notes.push(format!(
                "{name}: {} of {} messages do not fit their definition and are left out",
                self.broken, self.messages
            )),
            _ => {}
        }
        let long: &[String] = match &self.how {
            How::Ros(decoder) => &decoder.long,
            How::Protobuf(messages) => &messages.long,
            How::Json(_) | How::Unknown(_) => &[],
        };
        notes.extend(
            long.iter().map(|field| {
                format!("{name}.{field}: more than {MOST_ELEMENTS} elements; left out")
            }),
        );
    }
}

impl How {
    /// By the encoding of the messages and their definition.
    fn of(message_encoding: &str, schema: Option<&Schema<'_>>) -> Self {
        let ros = |encoding, Schema { name, data, .. }: &Schema<'_>| match Definitions::parse(
            name,
            &String::from_utf8_lossy(data),
        ) {
            Ok(definitions) => {
                let (root, long) = (Node::Unseen, Vec::new());
                Self::Ros(Box::new(Decoder { definitions, encoding, root, long }))
            }
            Err(what) => Self::Unknown(format!("{name}: {what}")),
        };
        match (message_encoding, schema) {
            ("cdr", Some(schema)) if schema.encoding == "ros2msg" => ros(Encoding::Cdr, schema),
            ("ros1", Some(schema)) if schema.encoding == "ros1msg" => ros(Encoding::Ros1, schema),
            ("protobuf", Some(schema)) if schema.encoding == "protobuf" => {
                match Messages::new(schema.name, schema.data) {
                    Ok(messages) => Self::Protobuf(Box::new(messages)),
                    Err(what) => Self::Unknown(format!("{}: {what}", schema.name)),
                }
            }
            ("json", _) => Self::Json(HashMap::new()),
            (encoding, schema) => {
                let schema = schema.map_or_else(String::new, |s| {
                    format!(
                        " with a schema in {}",
                        if s.encoding.is_empty() { "no language" } else { s.encoding }
                    )
                });
                Self::Unknown(format!("messages in {encoding}{schema} are not read"))
            }
        }
    }
}

impl Bag {
    pub(super) fn new(options: &ReadOptions, length: u64) -> Self {
        Self {
            stamps: options.stamps,
            budget: Budget::of(length, options),
            unchecked: options.unchecked,
            unknown: 0,
            part: 0,
            origin_ns: None,
            streams: BTreeMap::new(),
            same: HashMap::new(),
            notes: Notes::default(),
        }
    }

    /// Begins another file of the same bag.
    pub(super) fn next_part(&mut self) {
        self.part += 1;
    }

    /// The number of a channel among those of all files.
    fn key(&self, id: u64) -> u64 {
        id ^ self.part.rotate_right(16)
    }

    /// Adds a topic, unless its number is known already.
    pub(super) fn topic(
        &mut self,
        id: u64,
        name: &str,
        message_encoding: &str,
        schema: Option<&Schema<'_>>,
    ) {
        let id = self.key(id);
        if self.streams.contains_key(&id) || self.same.contains_key(&id) {
            return;
        }
        let kind =
            (message_encoding.to_owned(), schema.map(|s| (s.name.to_owned(), s.data.to_vec())));
        let called =
            self.streams.iter().filter(|(_, stream)| stream.topic == name).collect::<Vec<_>>();
        if let Some((first, _)) = called.iter().find(|(_, stream)| stream.kind == kind) {
            let (first, note) = (
                **first,
                format!(
                    "{name}: several channels of one definition are read as one topic, as from several senders"
                ),
            );
            self.same.insert(id, first);
            // In another file the topic only goes on.
            if self.part == 0 {
                self.notes.push_once(note);
            }
            return;
        }
        let table = if called.is_empty() {
            Table::new(name).within(&self.budget)
        } else {
            let numbered = format!("{name}[{}]", called.len());
            self.notes.push(format!(
                "{name}: channels of several definitions; the one of {} is called {numbered}",
                schema.map_or(message_encoding, |s| s.name)
            ));
            Table::new(numbered).within(&self.budget)
        };
        let how = How::of(message_encoding, schema);
        let stream = Stream {
            topic: name.to_owned(),
            kind,
            table,
            how,
            messages: 0,
            broken: 0,
            header: None,
            late_s: Vec::new(),
        };
        self.streams.insert(id, stream);
    }

    /// Adds a message of a topic; `ns` is the recorder's stamp in nanoseconds.
    pub(super) fn message(&mut self, id: u64, ns: i128, data: &[u8]) {
        let origin = *self.origin_ns.get_or_insert(ns);
        let id = self.key(id);
        let id = self.same.get(&id).copied().unwrap_or(id);
        let Some(stream) = self.streams.get_mut(&id) else {
            self.unknown += 1;
            return;
        };
        if self.budget.exceeded() {
            return;
        }
        stream.messages += 1;
        let table = &mut stream.table;
        table.row((ns - origin) as f64 / 1e9);
        let whole = match &mut stream.how {
            How::Unknown(_) => None,
            How::Ros(decoder) => decoder.message(data, table),
            How::Protobuf(messages) => messages.message(data, table),
            How::Json(columns) => serde_json::from_slice::<Value>(data)
                .ok()
                .map(|value| json(&value, "", columns, table)),
        };
        if whole.is_none() {
            table.drop_row();
            stream.broken += 1;
            return;
        }
        if stream.header.is_none() && stream.table.len() == 1 {
            stream.header = ["header.stamp", "timestamp"].into_iter().find_map(|name| {
                let place = |parts: &[&str]| {
                    parts.iter().find_map(|part| stream.table.place(&format!("{name}.{part}")))
                };
                Some((
                    name,
                    place(&["sec", "secs", "seconds"])?,
                    place(&["nanosec", "nsecs", "nsec", "nanos"])?,
                ))
            });
        }
        if let Some((_, sec, nanosec)) = stream.header {
            let table = &mut stream.table;
            if let (Some(sec), Some(nanosec)) = (table.last(sec), table.last(nanosec)) {
                let sent_ns = sec as i128 * 1_000_000_000 + nanosec as i128;
                stream.late_s.push((ns - sent_ns) as f64 / 1e9);
                if self.stamps == Stamps::Header {
                    table.restamp((sent_ns - origin) as f64 / 1e9);
                }
            }
        }
    }

    /// The topics with numbers.
    pub(super) fn finish(
        mut self,
        source: &str,
        format: &'static str,
        title: &'static str,
    ) -> Result<Recording, Error> {
        self.budget.check(source)?;
        if self.unknown > 0 {
            self.notes.push(format!(
                "{} messages are of channels that the file does not name, and are left out",
                self.unknown
            ));
        }
        let mut topics: Vec<Topic> = Vec::new();
        for stream in self.streams.into_values() {
            let name = stream.table.name().to_owned();
            stream.left_out(&name, &mut self.notes);
            if let Some(median_s) = stats::upper_median(stream.late_s) {
                let used = match self.stamps {
                    Stamps::Arrival => Message::from(
                        "the recorder's stamps are used, for the same clock everywhere (",
                    )
                    .and(Remedy::HeaderStamps)
                    .and(" takes the senders')"),
                    Stamps::Header => "the sender's stamps are used".into(),
                };
                let stamp = stream.header.map_or("header.stamp", |h| h.0);
                self.notes.push(
                    Message::from(format!(
                        "{name}: recorded {median_s:.6} s after {stamp} (median); "
                    ))
                    .and(used),
                );
            } else if self.stamps == Stamps::Header && stream.messages > stream.broken {
                self.notes.push(format!("{name}: has no stamp of its sender (header.stamp or timestamp); the recorder's stamps are used"));
            }
            topics.extend(stream.table.finish(source, &mut self.notes)?);
        }
        if let Some(origin) = self.origin_ns.filter(|_| !topics.is_empty()) {
            self.notes.push(format!(
                "time is counted from the first message ({}.{:09} s)",
                origin.div_euclid(1_000_000_000),
                origin.rem_euclid(1_000_000_000)
            ));
        }
        Recording::of_topics(source, (format, title), topics, self.notes)
    }
}

/// Puts the numbers of a JSON value into the row that was begun last.
fn json(value: &Value, path: &str, columns: &mut HashMap<String, usize>, table: &mut Table) {
    let number = match value {
        Value::Number(number) => number.as_f64(),
        Value::Bool(truth) => Some(f64::from(u8::from(*truth))),
        Value::Object(fields) => {
            for (name, value) in fields {
                let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
                json(value, &path, columns, table);
            }
            None
        }
        Value::Array(values) if values.len() <= MOST_ELEMENTS => {
            for (i, value) in values.iter().enumerate() {
                json(value, &format!("{path}[{i}]"), columns, table);
            }
            None
        }
        Value::Array(_) | Value::Null | Value::String(_) => None,
    };
    if let Some(number) = number {
        let name = if path.is_empty() { "value" } else { path };
        let column = match columns.get(name) {
            Some(column) => *column,
            None => *columns.entry(name.to_owned()).or_insert(table.column(name, None)),
        };
        table.set(column, number);
    }
}
