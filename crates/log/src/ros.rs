//! Messages of ROS 1 and ROS 2 by their definitions: numbers into columns, `twist.linear.x`, `position[2]`.
//!
//! Source: OMG CDR (XCDR1, plain), as ROS 2 middleware writes it; ROS wiki, "msg" and "TCPROS" for ROS 1.

use std::collections::HashMap;

use super::recording::Table;
use super::ros_types::definition;

/// Sequences and arrays longer than this are pictures, point clouds and scans, not channels.
pub(super) const MOST_ELEMENTS: usize = 64;
/// Messages within messages deeper than this are refused.
const DEEPEST: usize = 32;

/// How numbers stand in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    /// ROS 1: little-endian, without alignment.
    Ros1,
    /// ROS 2.
    Cdr,
}

/// A definition with all that it needs.
#[derive(Debug, Clone)]
pub(super) struct Definitions {
    messages: Vec<Vec<Field>>,
}

#[derive(Debug, Clone)]
struct Field {
    name: String,
    kind: Kind,
    count: Count,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Count {
    One,
    Fixed(usize),
    Any,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Bool,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
    Text,
    /// ROS 1 only: seconds and nanoseconds, unsigned or signed.
    Time,
    Duration,
    Message(usize),
}

impl Kind {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "bool" => Self::Bool,
            "int8" => Self::I8,
            "uint8" | "byte" | "char" => Self::U8,
            "int16" => Self::I16,
            "uint16" => Self::U16,
            "int32" => Self::I32,
            "uint32" => Self::U32,
            "int64" => Self::I64,
            "uint64" => Self::U64,
            "float32" => Self::F32,
            "float64" => Self::F64,
            "string" => Self::Text,
            "time" => Self::Time,
            "duration" => Self::Duration,
            _ => return None,
        })
    }

    fn size(self) -> Option<usize> {
        Some(match self {
            Self::Bool | Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
            Self::Text | Self::Time | Self::Duration | Self::Message(_) => return None,
        })
    }
}

impl Definitions {
    /// Reads a definition as bags hold it: the message `name`, then every message that it uses, behind lines of `=`. `Err` names what is missing.
    pub(super) fn parse(name: &str, text: &str) -> Result<Self, String> {
        let mut texts: HashMap<String, &str> = HashMap::new();
        let mut current = (plain(name), 0);
        let mut at = 0;
        for line in text.split_inclusive('\n') {
            let bare = line.trim();
            if bare.len() >= 3 && bare.bytes().all(|b| b == b'=') {
                texts.insert(
                    std::mem::take(&mut current.0),
                    text.get(current.1..at).unwrap_or_default(),
                );
                current.1 = at + line.len();
            } else if current.0.is_empty()
                && let Some(name) = bare.strip_prefix("MSG:")
            {
                current = (plain(name.trim()), at + line.len());
            }
            at += line.len();
        }
        texts.insert(current.0, text.get(current.1..).unwrap_or_default());
        let mut definitions = Self { messages: Vec::new() };
        definitions.message(&plain(name), &texts, &mut HashMap::new(), 0)?;
        Ok(definitions)
    }

    fn message(
        &mut self,
        name: &str,
        texts: &HashMap<String, &str>,
        known: &mut HashMap<String, usize>,
        depth: usize,
    ) -> Result<usize, String> {
        if let Some(at) = known.get(name) {
            return Ok(*at);
        }
        // A bag without definitions has an empty one.
        let text = texts
            .get(name)
            .copied()
            .filter(|text| !text.trim().is_empty())
            .or_else(|| definition(name))
            .or(texts.get(name).copied());
        let text = text
            .filter(|text| depth < DEEPEST && (depth > 0 || !text.is_empty()))
            .ok_or_else(|| format!("no definition of {name}"))?;
        let place = self.messages.len();
        self.messages.push(Vec::new());
        known.insert(name.to_owned(), place);
        let package = name.split('/').next().unwrap_or_default();
        let mut fields = Vec::new();
        for line in text.lines() {
            let line = line.split('#').next().unwrap_or_default().trim();
            let mut words = line.split_whitespace();
            let (Some(kind), Some(field)) = (words.next(), words.next()) else { continue };
            // Constants.
            if field.contains('=') || words.next().is_some_and(|w| w.starts_with('=')) {
                continue;
            }
            let (kind, count) = match kind.strip_suffix(']').and_then(|k| k.rsplit_once('[')) {
                Some((kind, "")) => (kind, Count::Any),
                Some((kind, bound)) if bound.starts_with("<=") => (kind, Count::Any),
                Some((kind, count)) => {
                    (kind, Count::Fixed(count.parse().map_err(|_| format!("`{line}`"))?))
                }
                None => (kind, Count::One),
            };
            let kind = kind.split("<=").next().unwrap_or(kind);
            let kind = match Kind::of(kind) {
                Some(kind) => kind,
                None => {
                    let whole = match plain(kind) {
                        name if name == "Header" => "std_msgs/Header".to_owned(),
                        name if name.contains('/') => name,
                        name => format!("{package}/{name}"),
                    };
                    Kind::Message(self.message(&whole, texts, known, depth + 1)?)
                }
            };
            fields.push(Field { name: field.to_owned(), kind, count });
        }
        if let Some(message) = self.messages.get_mut(place) {
            *message = fields;
        }
        Ok(place)
    }
}

/// `geometry_msgs/msg/Twist` is `geometry_msgs/Twist`.
fn plain(name: &str) -> String {
    name.replace("/msg/", "/")
}

/// The columns of a message, found while messages are read.
#[derive(Debug, Default)]
pub(super) enum Node {
    #[default]
    Unseen,
    Number(usize),
    Parts(Vec<Node>),
    Skipped,
}

/// Messages of one kind into a table.
#[derive(Debug)]
pub(super) struct Decoder {
    pub(super) definitions: Definitions,
    pub(super) encoding: Encoding,
    pub(super) root: Node,
    /// Fields that are left out because they are too long.
    pub(super) long: Vec<String>,
}

struct Bytes<'a> {
    bytes: &'a [u8],
    at: usize,
    big: bool,
    aligned: bool,
}

impl Bytes<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        if self.aligned {
            self.at = self.at.checked_next_multiple_of(N)?;
        }
        let mut bytes: [u8; N] =
            self.bytes.get(self.at..self.at.checked_add(N)?)?.try_into().ok()?;
        self.at += N;
        if self.big {
            bytes.reverse();
        }
        Some(bytes)
    }

    fn skip(&mut self, count: usize, size: usize) -> Option<()> {
        if self.aligned && count > 0 {
            self.at = self.at.checked_next_multiple_of(size)?;
        }
        self.at = self.at.checked_add(count.checked_mul(size)?)?;
        (self.at <= self.bytes.len()).then_some(())
    }

    fn length(&mut self) -> Option<usize> {
        // Every element takes a byte at least.
        let length = u32::from_le_bytes(self.take()?) as usize;
        (length <= self.bytes.len().saturating_sub(self.at)).then_some(length)
    }

    fn number(&mut self, kind: Kind) -> Option<f64> {
        Some(match kind {
            Kind::Bool | Kind::U8 => f64::from(u8::from_le_bytes(self.take()?)),
            Kind::I8 => f64::from(i8::from_le_bytes(self.take()?)),
            Kind::I16 => f64::from(i16::from_le_bytes(self.take()?)),
            Kind::U16 => f64::from(u16::from_le_bytes(self.take()?)),
            Kind::I32 => f64::from(i32::from_le_bytes(self.take()?)),
            Kind::U32 => f64::from(u32::from_le_bytes(self.take()?)),
            Kind::I64 => i64::from_le_bytes(self.take()?) as f64,
            Kind::U64 => u64::from_le_bytes(self.take()?) as f64,
            Kind::F32 => f64::from(f32::from_le_bytes(self.take()?)),
            Kind::F64 => f64::from_le_bytes(self.take()?),
            Kind::Text | Kind::Time | Kind::Duration | Kind::Message(_) => return None,
        })
    }
}

impl Decoder {
    /// Puts the numbers of a message into the row that was begun last; `None` where the bytes do not fit the definition.
    pub(super) fn message(&mut self, data: &[u8], table: &mut Table) -> Option<()> {
        let mut bytes = match self.encoding {
            Encoding::Ros1 => Bytes { bytes: data, at: 0, big: false, aligned: false },
            Encoding::Cdr => {
                // Plain CDR of either byte order; parameter lists and XCDR2 are not used for messages.
                let big = match data.get(..2)? {
                    [0, 0] => true,
                    [0, 1] => false,
                    _ => return None,
                };
                Bytes { bytes: data.get(4..)?, at: 0, big, aligned: true }
            }
        };
        let mut walk = Walk {
            definitions: &self.definitions,
            table,
            long: &mut self.long,
            path: String::new(),
        };
        walk.kind(&mut bytes, Kind::Message(0), Some(&mut self.root))
    }
}

struct Walk<'a> {
    definitions: &'a Definitions,
    table: &'a mut Table,
    long: &'a mut Vec<String>,
    path: String,
}

impl Walk<'_> {
    fn field(
        &mut self,
        bytes: &mut Bytes<'_>,
        field: &Field,
        node: Option<&mut Node>,
    ) -> Option<()> {
        let count = match field.count {
            Count::One => return self.kind(bytes, field.kind, node),
            Count::Fixed(count) => count,
            Count::Any => bytes.length()?,
        };
        let mut node = node.filter(|node| !matches!(node, Node::Skipped));
        if let Some(Node::Unseen) = node.as_deref()
            && count > MOST_ELEMENTS
        {
            self.long.push(self.path.clone());
            if let Some(node) = node.take() {
                *node = Node::Skipped;
            }
        }
        if let (None, Some(size)) = (&node, field.kind.size()) {
            return bytes.skip(count, size);
        }
        let mut parts = node.and_then(parts);
        for i in 0..count {
            let length = self.path.len();
            self.path += &format!("[{i}]");
            let part = parts.as_mut().filter(|_| i < MOST_ELEMENTS).map(|parts| {
                if parts.len() <= i {
                    parts.resize_with(i + 1, Node::default);
                }
                parts.get_mut(i)
            });
            self.kind(bytes, field.kind, part.flatten())?;
            self.path.truncate(length);
        }
        Some(())
    }

    fn kind(&mut self, bytes: &mut Bytes<'_>, kind: Kind, node: Option<&mut Node>) -> Option<()> {
        match kind {
            Kind::Message(place) => {
                let mut parts = node.and_then(parts);
                let definitions = self.definitions;
                for (i, field) in definitions.messages.get(place)?.iter().enumerate() {
                    let length = self.path.len();
                    if length > 0 {
                        self.path.push('.');
                    }
                    self.path += &field.name;
                    let part = parts.as_mut().map(|parts| {
                        if parts.len() <= i {
                            parts.resize_with(i + 1, Node::default);
                        }
                        parts.get_mut(i)
                    });
                    self.field(bytes, field, part.flatten())?;
                    self.path.truncate(length);
                }
                Some(())
            }
            Kind::Text => {
                let length = bytes.length()?;
                let aligned = std::mem::replace(&mut bytes.aligned, false);
                let skipped = bytes.skip(length, 1);
                bytes.aligned = aligned;
                skipped
            }
            Kind::Time | Kind::Duration => {
                let whole = if kind == Kind::Time { Kind::U32 } else { Kind::I32 };
                let mut parts = node.and_then(parts);
                for (i, name) in [".sec", ".nanosec"].into_iter().enumerate() {
                    let value = bytes.number(whole)?;
                    if let Some(parts) = &mut parts {
                        if parts.len() <= i {
                            parts.resize_with(i + 1, Node::default);
                        }
                        let length = self.path.len();
                        self.path += name;
                        self.put(value, parts.get_mut(i));
                        self.path.truncate(length);
                    }
                }
                Some(())
            }
            number => {
                let value = bytes.number(number)?;
                self.put(value, node);
                Some(())
            }
        }
    }

    fn put(&mut self, value: f64, node: Option<&mut Node>) {
        let Some(node) = node else { return };
        if let Node::Unseen = node {
            *node = Node::Number(self.table.column(self.path.clone(), None));
        }
        if let Node::Number(column) = node {
            self.table.set(*column, value);
        }
    }
}

fn parts(node: &mut Node) -> Option<&mut Vec<Node>> {
    if let Node::Unseen = node {
        *node = Node::Parts(Vec::new());
    }
    match node {
        Node::Parts(parts) => Some(parts),
        Node::Unseen | Node::Number(_) | Node::Skipped => None,
    }
}
