//! Tables whose keys keep the order they have in the file.

use std::collections::HashSet;
use std::fmt;
use std::marker::PhantomData;

use serde::de::{Deserialize, Deserializer, Error, MapAccess, Visitor};
use serde::ser::{Serialize, SerializeMap, Serializer};

/// Keys and values in order.
pub(super) type Table<T> = Vec<(String, T)>;

struct InOrder<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for InOrder<T> {
    type Value = Table<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a table")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Table<T>, A::Error> {
        let (mut table, mut known): (Table<T>, HashSet<String>) = Default::default();
        while let Some((key, value)) = map.next_entry::<String, T>()? {
            // TOML forbids this itself, JSON does not.
            if !known.insert(key.clone()) {
                return Err(A::Error::custom(format!("`{key}` is given twice")));
            }
            table.push((key, value));
        }
        Ok(table)
    }
}

pub(super) fn deserialize<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Table<T>, D::Error> {
    deserializer.deserialize_map(InOrder(PhantomData))
}

pub(super) fn serialize<S: Serializer, T: Serialize>(
    table: &Table<T>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    let mut map = serializer.serialize_map(Some(table.len()))?;
    for (key, value) in table {
        map.serialize_entry(key, value)?;
    }
    map.end()
}
