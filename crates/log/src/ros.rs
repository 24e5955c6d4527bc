//! Messages of ROS 1 and ROS 2 by their definitions: numbers into columns, `twist.linear.x`, `position[2]`.
//!
//! Source: OMG CDR (XCDR1, plain), as ROS 2 middleware writes it; ROS wiki, "msg" and "TCPROS" for ROS 1.

use std::collections::HashMap;

use super::recording::Table;
use super::ros_types::definition;
use super::scalar::Scalar;

/// Sequences and arrays longer than this are pictures, point clouds and scans, not channels.
pub(super) const MOST_ELEMENTS: usize = 64;
/// Messages within messages deeper than this are refused.
const DEEPEST: usize = 32;

/// The byte order of numbers.
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
    /// Fields of messages that take no byte are left out.
    messages: Vec<Vec<Field>>,
}

/// The state of a definition during the reading of its parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Known {
    Begun,
    /// Its place, and whether its messages take any byte.
    Whole(usize, bool),
}

#[derive(Debug, Clone)]
struct Field {
    name: String,
    kind: FieldKind,
    count: Count,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Count {
    One,
    Fixed(usize),
    Any,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FieldKind {
    Number(Scalar),
    Text,
    /// ROS 1 only: seconds and nanoseconds, unsigned or signed.
    Time(Scalar),
    Message(usize),
}

impl FieldKind {
    fn of(name: &str) -> Option<Self> {
        Some(Self::Number(match name {
            "int8" => Scalar::I8,
            "bool" | "uint8" | "byte" | "char" => Scalar::U8,
            "int16" => Scalar::I16,
            "uint16" => Scalar::U16,
            "int32" => Scalar::I32,
            "uint32" => Scalar::U32,
            "int64" => Scalar::I64,
            "uint64" => Scalar::U64,
            "float32" => Scalar::F32,
            "float64" => Scalar::F64,
            "string" => return Some(Self::Text),
            "time" => return Some(Self::Time(Scalar::U32)),
            "duration" => return Some(Self::Time(Scalar::I32)),
            _ => return None,
        }))
    }
}

impl Definitions {
    /// Reads a definition as bags hold it: the message `name`, then every message that it uses, behind lines of `=`. `Err` names the missing definition, or one
    /// that holds itself.
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
        known: &mut HashMap<String, Known>,
        depth: usize,
    ) -> Result<(usize, bool), String> {
        match known.get(name) {
            Some(Known::Begun) => return Err(format!("the definition of {name} holds itself")),
            Some(Known::Whole(place, takes)) => return Ok((*place, *takes)),
            None => {}
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
        known.insert(name.to_owned(), Known::Begun);
        let package = name.split('/').next().unwrap_or_default();
        let mut fields = Vec::new();
        for line in text.lines() {
            let line = line.split('#').next().unwrap_or_default().trim();
            let Some((kind, field)) = declared(line) else { continue };
            let (kind, count) = counted(kind).ok_or_else(|| format!("`{line}`"))?;
            let kind = match FieldKind::of(kind) {
                Some(kind) => kind,
                None => {
                    let whole = whole_name(kind, package);
                    let (place, takes) = self.message(&whole, texts, known, depth + 1)?;
                    // However many there are: only their count takes bytes.
                    if !takes && count != Count::Any {
                        continue;
                    }
                    FieldKind::Message(place)
                }
            };
            if count == Count::Fixed(0) {
                continue;
            }
            fields.push(Field { name: field.to_owned(), kind, count });
        }
        let takes = !fields.is_empty();
        known.insert(name.to_owned(), Known::Whole(place, takes));
        if let Some(message) = self.messages.get_mut(place) {
            *message = fields;
        }
        Ok((place, takes))
    }
}

/// The type and the name of a field in a line of a definition; `None` for a constant or an empty line.
fn declared(line: &str) -> Option<(&str, &str)> {
    let mut words = line.split_whitespace();
    let (kind, field) = (words.next()?, words.next()?);
    let constant = field.contains('=') || words.next().is_some_and(|w| w.starts_with('='));
    (!constant).then_some((kind, field))
}

/// A type without brackets and bounds, and its count; `None` where the count is no number.
fn counted(kind: &str) -> Option<(&str, Count)> {
    let (kind, count) = match kind.strip_suffix(']').and_then(|k| k.rsplit_once('[')) {
        Some((kind, "")) => (kind, Count::Any),
        Some((kind, bound)) if bound.starts_with("<=") => (kind, Count::Any),
        Some((kind, count)) => (kind, Count::Fixed(count.parse().ok()?)),
        None => (kind, Count::One),
    };
    Some((kind.split("<=").next().unwrap_or(kind), count))
}

/// The name of a message's type with its package; `package` is that of the message that uses it.
fn whole_name(kind: &str, package: &str) -> String {
    match plain(kind) {
        name if name == "Header" => "std_msgs/Header".to_owned(),
        name if name.contains('/') => name,
        name => format!("{package}/{name}"),
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
    fn skip(&mut self, count: usize, size: usize) -> Option<()> {
        if self.aligned && count > 0 {
            self.at = self.at.checked_next_multiple_of(size)?;
        }
        self.at = self.at.checked_add(count.checked_mul(size)?)?;
        (self.at <= self.bytes.len()).then_some(())
    }

    fn length(&mut self) -> Option<usize> {
        // Every element takes a byte at least.
        let length = self.number(Scalar::U32)? as usize;
        (length <= self.bytes.len().saturating_sub(self.at)).then_some(length)
    }

    fn number(&mut self, scalar: Scalar) -> Option<f64> {
        let size = scalar.size();
        if self.aligned {
            self.at = self.at.checked_next_multiple_of(size)?;
        }
        let value = scalar.value(self.bytes.get(self.at..)?, self.big)?;
        self.at += size;
        Some(value)
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
        walk.kind(&mut bytes, FieldKind::Message(0), Some(&mut self.root))
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
        if let (None, FieldKind::Number(scalar)) = (&node, field.kind) {
            return bytes.skip(count, scalar.size());
        }
        // Elements that take no byte hold no number.
        if let FieldKind::Message(place) = field.kind
            && self.definitions.messages.get(place).is_none_or(Vec::is_empty)
        {
            return Some(());
        }
        let mut parts = node.and_then(parts);
        for i in 0..count {
            let length = self.path.len();
            self.path += &format!("[{i}]");
            let part = parts.as_mut().filter(|_| i < MOST_ELEMENTS).and_then(|p| part(p, i));
            self.kind(bytes, field.kind, part)?;
            self.path.truncate(length);
        }
        Some(())
    }

    fn kind(
        &mut self,
        bytes: &mut Bytes<'_>,
        kind: FieldKind,
        node: Option<&mut Node>,
    ) -> Option<()> {
        match kind {
            FieldKind::Message(place) => {
                let mut parts = node.and_then(parts);
                let definitions = self.definitions;
                for (i, field) in definitions.messages.get(place)?.iter().enumerate() {
                    let length = self.path.len();
                    if length > 0 {
                        self.path.push('.');
                    }
                    self.path += &field.name;
                    self.field(bytes, field, parts.as_mut().and_then(|p| part(p, i)))?;
                    self.path.truncate(length);
                }
                Some(())
            }
            FieldKind::Text => {
                let length = bytes.length()?;
                let aligned = std::mem::replace(&mut bytes.aligned, false);
                let skipped = bytes.skip(length, 1);
                bytes.aligned = aligned;
                skipped
            }
            FieldKind::Time(whole) => {
                let mut parts = node.and_then(parts);
                for (i, name) in [".sec", ".nanosec"].into_iter().enumerate() {
                    let value = bytes.number(whole)?;
                    if let Some(parts) = &mut parts {
                        let length = self.path.len();
                        self.path += name;
                        self.put(value, part(parts, i));
                        self.path.truncate(length);
                    }
                }
                Some(())
            }
            FieldKind::Number(scalar) => {
                let value = bytes.number(scalar)?;
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

/// The part of this number, whether it was seen before or not.
pub(super) fn part<N: Default>(parts: &mut Vec<N>, at: usize) -> Option<&mut N> {
    if parts.len() <= at {
        parts.resize_with(at + 1, N::default);
    }
    parts.get_mut(at)
}
