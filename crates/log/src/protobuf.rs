//! Messages of Protocol Buffers by the definitions in the file: numbers into columns, `force.x`, `currents[2]`, `gains[kp]`.
//!
//! Source: Protocol Buffers documentation, "Encoding" and "Application Note: Field Presence"; MCAP format specification, "Well-known schema encodings".

use prost_reflect::{
    DescriptorPool, DynamicMessage, FieldDescriptor, Kind, MapKey, MessageDescriptor,
    ReflectMessage, Value,
};

use super::recording::Table;
use super::ros::{MOST_ELEMENTS, part};

/// Messages of one kind into a table.
pub(super) struct Messages {
    definition: MessageDescriptor,
    root: Node,
    /// Fields that are left out because they are too long.
    pub(super) long: Vec<String>,
}

/// The columns of a field, found while messages are read.
#[derive(Default)]
enum Node {
    #[default]
    Unseen,
    Number(usize),
    Parts(Vec<Node>),
    /// For a map: the type of its keys, and their columns.
    Keys(Vec<(MapKey, Node)>),
    Skipped,
}

impl Messages {
    /// The messages `name` of a set of descriptors. `Err` has the fault, and the remedy.
    pub(super) fn new(name: &str, descriptors: &[u8]) -> Result<Self, String> {
        let pool = DescriptorPool::decode(descriptors)
            .map_err(|e| format!("its schema is no complete set of descriptors ({e}); record it with every file that it imports"))?;
        let definition = pool.get_message_by_name(name).ok_or_else(|| {
            let known: Vec<_> =
                pool.all_messages().take(5).map(|m| m.full_name().to_owned()).collect();
            format!(
                "its schema has no such message, only {}",
                if known.is_empty() { "none".to_owned() } else { known.join(", ") }
            )
        })?;
        Ok(Self { definition, root: Node::Unseen, long: Vec::new() })
    }

    /// Puts the numbers of a message into the row that was begun last; `None` where the bytes do not fit the definition.
    pub(super) fn message(&mut self, data: &[u8], table: &mut Table) -> Option<()> {
        let message = DynamicMessage::decode(self.definition.clone(), data).ok()?;
        let mut walk = MessageWalk { table, long: &mut self.long, path: String::new() };
        walk.message(&message, &mut self.root);
        Some(())
    }
}

struct MessageWalk<'a> {
    table: &'a mut Table,
    long: &'a mut Vec<String>,
    path: String,
}

impl MessageWalk<'_> {
    fn message(&mut self, message: &DynamicMessage, node: &mut Node) {
        let Some(parts) = parts(node) else { return };
        for (i, field) in message.descriptor().fields().enumerate() {
            let Some(part) = part(parts, i) else { continue };
            // A number that was not sent is 0, unless the schema distinguishes the two.
            if matches!(part, Node::Skipped)
                || field.supports_presence() && !message.has_field(&field)
            {
                continue;
            }
            if !numeric(&field) {
                *part = Node::Skipped;
                continue;
            }
            let length = self.path.len();
            if length > 0 {
                self.path.push('.');
            }
            self.path += field.name();
            self.value(&message.get_field(&field), part);
            self.path.truncate(length);
        }
    }

    fn value(&mut self, value: &Value, node: &mut Node) {
        let number = match value {
            Value::Bool(truth) => f64::from(u8::from(*truth)),
            Value::I32(number) | Value::EnumNumber(number) => f64::from(*number),
            Value::U32(number) => f64::from(*number),
            Value::I64(number) => *number as f64,
            Value::U64(number) => *number as f64,
            Value::F32(number) => f64::from(*number),
            Value::F64(number) => *number,
            Value::Message(message) => return self.message(message, node),
            Value::List(values) => return self.list(values, node),
            Value::Map(values) => {
                let mut values: Vec<_> = values.iter().collect();
                values.sort_by(|a, b| a.0.cmp(b.0));
                return self.map(&values, node);
            }
            Value::String(_) | Value::Bytes(_) => return,
        };
        if let Node::Unseen = node {
            *node = Node::Number(self.table.column(self.path.clone(), None));
        }
        if let Node::Number(column) = node {
            self.table.set(*column, number);
        }
    }

    fn list(&mut self, values: &[Value], node: &mut Node) {
        if self.too_long(values.len(), node) {
            return;
        }
        let Some(parts) = parts(node) else { return };
        for (i, value) in values.iter().take(MOST_ELEMENTS).enumerate() {
            if let Some(part) = part(parts, i) {
                self.within(&i.to_string(), value, part);
            }
        }
    }

    fn map(&mut self, values: &[(&MapKey, &Value)], node: &mut Node) {
        if self.too_long(values.len(), node) {
            return;
        }
        if let Node::Unseen = node {
            *node = Node::Keys(Vec::new());
        }
        let Node::Keys(keys) = node else { return };
        for (key, value) in values {
            let place = keys.iter().position(|k| k.0 == **key);
            if place.is_none() && keys.len() < MOST_ELEMENTS {
                keys.push(((*key).clone(), Node::Unseen));
            }
            let last = keys.len().saturating_sub(1);
            let Some(known) = keys.get_mut(place.unwrap_or(last)).filter(|k| k.0 == **key) else {
                continue;
            };
            let name = match key {
                MapKey::Bool(key) => key.to_string(),
                MapKey::I32(key) => key.to_string(),
                MapKey::I64(key) => key.to_string(),
                MapKey::U32(key) => key.to_string(),
                MapKey::U64(key) => key.to_string(),
                MapKey::String(key) => key.clone(),
            };
            self.within(&name, value, &mut known.1);
        }
    }

    /// Whether it is longer than channels are; then it is left out from the first message on.
    fn too_long(&mut self, count: usize, node: &mut Node) -> bool {
        if let Node::Unseen = node
            && count > MOST_ELEMENTS
        {
            self.long.push(self.path.clone());
            *node = Node::Skipped;
        }
        matches!(node, Node::Skipped)
    }

    fn within(&mut self, index: &str, value: &Value, node: &mut Node) {
        let length = self.path.len();
        self.path.push('[');
        self.path += index;
        self.path.push(']');
        self.value(value, node);
        self.path.truncate(length);
    }
}

/// Whether a field can hold numbers: other fields are not copied.
fn numeric(field: &FieldDescriptor) -> bool {
    let kind = match field.kind() {
        Kind::Message(entry) if field.is_map() => entry.map_entry_value_field().kind(),
        kind => kind,
    };
    !matches!(kind, Kind::String | Kind::Bytes)
}

fn parts(node: &mut Node) -> Option<&mut Vec<Node>> {
    if let Node::Unseen = node {
        *node = Node::Parts(Vec::new());
    }
    match node {
        Node::Parts(parts) => Some(parts),
        Node::Unseen | Node::Number(_) | Node::Keys(_) | Node::Skipped => None,
    }
}
