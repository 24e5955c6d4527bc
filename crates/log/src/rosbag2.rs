//! rosbag2 in SQLite: tables of topics and messages, with definitions since ROS 2 Iron.

use std::collections::HashMap;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use super::bag::{Bag, Schema};
use super::counted::Counted;
use super::error::{Error, LogError};
use super::options::ReadOptions;
use super::recording::Recording;
use super::sqlite::{Database, SqlTable};

pub(super) const MAGIC: &[u8] = b"SQLite format 3\0";
const NAME: &str = "a ROS 2 bag in SQLite";

/// Reads a `.db3` file.
pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Recording, Error> {
    let file = Counted::open(path, &options.far).map_err(|e| Error::io(path, e))?;
    let mut bag = Bag::new(options, file.length());
    bag.notes.extend(journal(path));
    let source = path.display().to_string();
    fill(&source, BufReader::new(file), &mut bag)?;
    bag.finish(&source, "rosbag2", NAME)
}

/// The note where the database was not closed.
pub(super) fn journal(path: &Path) -> Option<String> {
    let mut journal = path.as_os_str().to_owned();
    journal.push("-wal");
    let there = std::fs::metadata(&journal).is_ok_and(|m| m.len() > 0);
    there.then(|| "the write-ahead log (the file that ends in -wal) is not read; open and close the bag once with sqlite3".to_owned())
}

/// Reads a database, perhaps one of several, into a bag.
pub(super) fn fill(source: &str, bytes: impl Read + Seek, bag: &mut Bag) -> Result<(), Error> {
    let refused = |what: &str| LogError::format(source, NAME, what);
    let Some(mut base) = Database::open(bytes).map_err(|e| Error::io(Path::new(source), e))? else {
        return Err(
            refused("the file is cut off or damaged at its beginning; copy it again").into()
        );
    };
    let tables: HashMap<String, _> = base.tables().into_iter().collect();
    let (Some(topics), Some(messages)) = (tables.get("topics"), tables.get("messages")) else {
        return Err(refused(
            "this database has no tables `topics` and `messages`, so it is no bag",
        )
        .into());
    };
    let definitions = match tables.get("message_definitions") {
        Some(table) => definitions(&mut base, table),
        None => HashMap::new(),
    };
    let places = ["id", "name", "type", "serialization_format"].map(|name| topics.column(name));
    base.rows(topics, &mut |row| {
        let [id, name, kind, encoding] = places.map(|place| place.and_then(|p| row.get(p)));
        let (Some(id), Some(name), Some(kind)) = (
            id.and_then(|v| v.integer()),
            name.and_then(|v| v.text()),
            kind.and_then(|v| v.text()),
        ) else {
            return;
        };
        let encoding = encoding.and_then(|v| v.text()).unwrap_or_else(|| "cdr".to_owned());
        // Without a definition the common messages of ROS 2 are known by their names.
        let (language, data) = definitions
            .get(&kind)
            .map_or(("ros2msg", [].as_slice()), |(e, d)| (e.as_str(), d.as_slice()));
        let schema = Schema {
            name: &kind,
            encoding: if data.is_empty() { "ros2msg" } else { language },
            data,
        };
        bag.topic(id as u64, &name, &encoding, Some(&schema));
    });
    let places = ["topic_id", "timestamp", "data"].map(|name| messages.column(name));
    base.rows(messages, &mut |row| {
        let [topic, stamp, data] = places.map(|place| place.and_then(|p| row.get(p)));
        if let (Some(topic), Some(stamp), Some(data)) = (
            topic.and_then(|v| v.integer()),
            stamp.and_then(|v| v.integer()),
            data.and_then(|v| v.bytes()),
        ) {
            bag.message(topic as u64, i128::from(stamp), data);
        }
    });
    if base.lost > 0 {
        bag.notes.push(format!(
            "{} pages or rows are cut off or damaged; the messages on them are left out",
            base.lost
        ));
    }
    Ok(())
}

/// How the definition of every type of message is written, and the definition.
fn definitions<R: Read + Seek>(
    base: &mut Database<R>,
    table: &SqlTable,
) -> HashMap<String, (String, Vec<u8>)> {
    let mut definitions = HashMap::new();
    let places =
        ["topic_type", "encoding", "encoded_message_definition"].map(|name| table.column(name));
    base.rows(table, &mut |row| {
        let [name, encoding, text] = places.map(|place| place.and_then(|p| row.get(p)));
        if let (Some(name), Some(encoding), Some(text)) = (
            name.and_then(|v| v.text()),
            encoding.and_then(|v| v.text()),
            text.and_then(|v| v.bytes()),
        ) {
            definitions.insert(name, (encoding, text.to_vec()));
        }
    });
    definitions
}
