//! MATLAB's objects: MAT files of version 5 to 7.3 keep their properties in the cells of a `FileWrapper__`, and refer to them by numbers.
//!
//! Source: "Subsystem Data Format" of the project matio (foreverallama/matio), which found out what MathWorks does not document. The objects that hold signals are read:
//! `timeseries`, `timetable`, `table`, `Simulink.SimulationOutput`, `Simulink.SimulationData.Dataset`; of others the properties, as a struct.

use std::borrow::Cow;

use super::arrays::Array;
use super::options::TimeUnit;
use crate::notes::Notes;

/// The first number of a reference to an object.
const MARK: f64 = 3_707_764_736.0;
/// Objects within objects deeper than this are left out: an object may hold itself.
const DEEPEST: usize = 16;
/// Several objects may share the contents of the wrapper: the limit of the reading, as a multiple of the wrapper's size.
const SHARED: usize = 4;

/// Whether numbers refer to an object.
pub(super) fn refers(values: &[f64]) -> bool {
    values.len() > 4 && values.first() == Some(&MARK)
}

/// Puts objects in the place of what refers to them.
pub(super) fn resolve(
    variables: &mut [(String, Array)],
    cells: Option<Vec<Array>>,
    notes: &mut Notes,
) {
    let wrapper = cells.and_then(Wrapper::new);
    let left =
        wrapper.as_ref().map_or(0, |w| SHARED * w.values.iter().map(size).sum::<usize>() + 10_000);
    let mut objects = Objects { wrapper: wrapper.as_ref(), left, notes };
    for (name, array) in variables {
        objects.fill(name, array, false, 0);
    }
}

/// The last part of a path: a name without its parents.
fn last(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or(path)
}

fn join(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}

/// Numbers, letters and parts of an array.
fn size(array: &Array) -> usize {
    1 + match array {
        Array::Numbers { values, .. } | Array::Times { values, .. } | Array::Object(values) => {
            values.len()
        }
        Array::Text(text) => text.len(),
        Array::Struct(fields) => fields.iter().map(|(name, field)| name.len() + size(field)).sum(),
        Array::List(elements) => elements.iter().map(size).sum(),
        Array::Other => 0,
    }
}

fn texts(array: &Array) -> Vec<&str> {
    match array {
        Array::Text(text) => vec![text],
        Array::List(elements) => elements
            .iter()
            .map(|e| if let Array::Text(text) = e { text.as_str() } else { "" })
            .collect(),
        _ => Vec::new(),
    }
}

fn first_number(array: &Array) -> Option<f64> {
    if let Array::Numbers { values, .. } = array { values.first().copied() } else { None }
}

/// The cells of a `FileWrapper__`.
struct Wrapper {
    names: Vec<String>,
    classes: Vec<String>,
    /// Class, the record of what its `saveobj` gave, and the record of its properties.
    objects: Vec<[usize; 3]>,
    saved: Vec<Vec<[usize; 3]>>,
    plain: Vec<Vec<[usize; 3]>>,
    values: Vec<Array>,
    defaults: Vec<Array>,
}

impl Wrapper {
    fn new(mut cells: Vec<Array>) -> Option<Self> {
        let Array::Numbers { values, .. } = cells.first()? else { return None };
        let bytes: Vec<u8> = values.iter().map(|x| *x as u8).collect();
        let (words, _) = bytes.as_chunks::<4>();
        let read = |swap: bool| -> Vec<usize> {
            words.iter().map(|word| if swap { u32::from_be_bytes(*word) } else { u32::from_le_bytes(*word) } as usize).collect()
        };
        let known =
            |words: &Vec<usize>| words.first().is_some_and(|version| (2..=4).contains(version));
        let words = Some(read(false)).filter(known).or_else(|| Some(read(true)).filter(known))?;
        let (version, count) = (*words.first()?, *words.get(1)?);
        // Where regions begin, in bytes: classes, what `saveobj` gave, objects, properties; and where these end.
        let begins = |region: usize| words.get(2 + region).copied();
        let region = |region: usize| words.get(begins(region)? / 4..begins(region + 1)? / 4);
        let letters = bytes.get(40..begins(0)?)?.split(|b| *b == 0).filter(|name| !name.is_empty());
        let names: Vec<String> =
            letters.take(count).map(|name| String::from_utf8_lossy(name).into_owned()).collect();
        let class = |[space, name, ..]: &[usize; 4]| {
            let name_of = |number: usize| names.get(number.checked_sub(1)?).map(String::as_str);
            join(name_of(*space).unwrap_or_default(), name_of(*name).unwrap_or_default())
        };
        let classes = region(0)?.as_chunks::<4>().0.iter().map(class).collect();
        let objects = region(2)?
            .as_chunks::<6>()
            .0
            .iter()
            .map(|[class, _, _, saved, plain, _]| [*class, *saved, *plain])
            .collect();
        let (saved, plain) = (records(region(1)?), records(region(3)?));
        let defaults =
            if let Some(Array::List(defaults)) = cells.pop() { defaults } else { Vec::new() };
        // Behind the values are aliases of classes, and an undocumented part.
        cells.truncate(cells.len().saturating_sub(version - 2));
        let values = cells.into_iter().skip(2).collect();
        Some(Self { names, classes, objects, saved, plain, values, defaults })
    }

    /// The class of an object and its properties.
    fn object(&self, id: usize) -> Option<(&str, Properties<'_>)> {
        let [class, saved, plain] = *self.objects.get(id)?;
        let record = if saved > 0 { self.saved.get(saved) } else { self.plain.get(plain) }?;
        let name = |number: usize| self.names.get(number.checked_sub(1)?).map(String::as_str);
        let mut found = Vec::with_capacity(record.len());
        for [property, kind, value] in record {
            let array = match kind {
                0 => Cow::Owned(Array::Text(name(*value)?.to_owned())),
                1 => Cow::Borrowed(self.values.get(*value)?),
                _ => Cow::Owned(Array::Numbers { shape: vec![1, 1], values: vec![*value as f64] }),
            };
            found.push((name(*property)?, array));
        }
        // The result of a class's `saveobj` is one struct instead of properties.
        if let [("any", Cow::Borrowed(Array::Struct(fields)))] = found.as_slice() {
            found =
                fields.iter().map(|(name, array)| (name.as_str(), Cow::Borrowed(array))).collect();
        }
        if let Some(Array::Struct(fields)) = self.defaults.get(class) {
            let default = |(field, array): &'_ (String, Array)| {
                !found.iter().any(|(name, _)| name == field) && !matches!(array, Array::Other)
            };
            let more: Vec<_> = fields
                .iter()
                .filter(|f| default(f))
                .map(|(name, array)| (name.as_str(), Cow::Borrowed(array)))
                .collect();
            found.extend(more);
        }
        Some((self.classes.get(class)?, Properties(found)))
    }

    /// The properties of the object that numbers refer to, where it is one.
    fn only(&self, array: &Array) -> Option<(&str, Properties<'_>)> {
        match ids(array)? {
            [id] => self.object(*id as usize),
            _ => None,
        }
    }
}

/// Records of three words each, behind their count, each record at an even place.
fn records(words: &[usize]) -> Vec<Vec<[usize; 3]>> {
    let (mut found, mut at) = (Vec::new(), 0);
    while let Some(count) = words.get(at) {
        let end = count.saturating_mul(3).saturating_add(at + 1);
        let Some(record) = words.get(at + 1..end) else { break };
        found.push(record.as_chunks::<3>().0.to_vec());
        at = end + end % 2;
    }
    found
}

/// The numbers of objects that an array refers to: they are behind its dimensions, and before the number of its class.
fn ids(array: &Array) -> Option<&[f64]> {
    let (Array::Numbers { values, .. } | Array::Object(values)) = array else { return None };
    if !refers(values) {
        return None;
    }
    let dimensions = *values.get(1)? as usize;
    values.get(dimensions.checked_add(2)?..values.len() - 1)
}

/// The properties of an object.
struct Properties<'a>(Vec<(&'a str, Cow<'a, Array>)>);

impl Properties<'_> {
    /// A property that is not empty; inner ones are called the same with `_` behind.
    fn get(&self, name: &str) -> Option<&Array> {
        let empty = |array: &Array| match array {
            Array::Numbers { values, .. } => values.is_empty(),
            Array::List(elements) => elements.is_empty(),
            other => matches!(other, Array::Other),
        };
        self.0
            .iter()
            .find(|(own, array)| own.strip_suffix('_').unwrap_or(own) == name && !empty(array))
            .map(|(_, array)| array.as_ref())
    }

    fn number(&self, name: &str) -> Option<f64> {
        first_number(self.get(name)?)
    }

    fn text(&self, name: &str) -> Option<&str> {
        if let Array::Text(text) = self.get(name)? {
            Some(text.trim()).filter(|t| !t.is_empty())
        } else {
            None
        }
    }
}

/// Objects while they are put into their places.
struct Objects<'a, 'n> {
    wrapper: Option<&'a Wrapper>,
    /// The remaining amount that may be read from the wrapper.
    left: usize,
    notes: &'n mut Notes,
}

impl<'a> Objects<'a, '_> {
    /// Fills an array with objects; within the wrapper plain numbers refer to them as well.
    fn fill(&mut self, path: &str, array: &mut Array, within: bool, depth: usize) {
        match array {
            Array::Object(_) => *array = self.objects(path, array, depth),
            Array::Numbers { values, .. } if within && refers(values) => {
                *array = self.objects(path, array, depth)
            }
            Array::Struct(fields) => {
                for (name, field) in fields {
                    self.fill(&join(path, name), field, within, depth);
                }
            }
            Array::List(elements) => {
                for (k, element) in elements.iter_mut().enumerate() {
                    self.fill(&format!("{path}[{}]", k + 1), element, within, depth);
                }
            }
            _ => {}
        }
    }

    /// A value of the wrapper with its objects.
    fn taken(&mut self, path: &str, value: &Array, depth: usize) -> Option<Array> {
        self.spend(size(value))?;
        let mut value = value.clone();
        self.fill(path, &mut value, true, depth + 1);
        Some(value)
    }

    fn spend(&mut self, cost: usize) -> Option<()> {
        self.left = self.left.checked_sub(cost)?;
        Some(())
    }

    fn objects(&mut self, path: &str, reference: &Array, depth: usize) -> Array {
        let Some(wrapper) = self.wrapper else {
            self.notes.push(format!("{path}: an object of MATLAB, but what it holds is not in the file, or is damaged; left out"));
            return Array::Other;
        };
        let Some(ids) = ids(reference) else {
            self.notes.push(format!(
                "{path}: no object of MATLAB's own (Java, COM), or damaged; left out"
            ));
            return Array::Other;
        };
        let mut found = Vec::new();
        for (k, id) in ids.iter().enumerate() {
            if depth > DEEPEST || self.spend(1).is_none() {
                self.notes.push(format!("{path}: objects within objects without end; left out"));
                break;
            }
            let path = if ids.len() > 1 { format!("{path}[{}]", k + 1) } else { path.to_owned() };
            let Some((class, properties)) = wrapper.object(*id as usize) else {
                self.notes.push(format!("{path}: a damaged object of MATLAB; left out"));
                continue;
            };
            match self.object(&path, class, &properties, depth) {
                Some(array) => found.push(array),
                None => self.notes.push(format!(
                    "{path}: this `{class}` is empty, or holds no plain numbers; save it as a struct: s.time = …; s.{} = …",
                    last(&path)
                )),
            }
        }
        if found.len() == 1 { found.pop().unwrap_or(Array::Other) } else { Array::List(found) }
    }

    fn object(
        &mut self,
        path: &str,
        class: &str,
        properties: &Properties<'a>,
        depth: usize,
    ) -> Option<Array> {
        match class {
            "timeseries" | "Simulink.Timeseries" => self.series(path, properties),
            "datetime" | "duration" => {
                let Array::Numbers { values, .. } =
                    properties.get("data").or_else(|| properties.get("millis"))?
                else {
                    return None;
                };
                self.spend(values.len())?;
                Some(Array::Times { values: values.clone(), unit: TimeUnit::Ms })
            }
            "timetable" => self.timetable(path, properties, depth),
            "table" => Some(Array::Struct(self.columns(
                path,
                properties.get("varnames")?,
                properties.get("data")?,
                depth,
            )?)),
            "Simulink.SimulationOutput" => self.taken(path, properties.get("Data")?, depth),
            "Simulink.SimulationData.Dataset" => self.dataset(path, properties, depth),
            // The targets of a function; texts.
            "function_handle_workspace" | "string" => Some(Array::Other),
            _ => match properties.get("Values") {
                Some(values) if class.starts_with("Simulink.SimulationData.") => {
                    self.taken(path, values, depth)
                }
                _ => {
                    let mut fields = Vec::with_capacity(properties.0.len());
                    for (name, value) in &properties.0 {
                        fields.push((
                            (*name).to_owned(),
                            self.taken(&join(path, name), value, depth)?,
                        ));
                    }
                    Some(Array::Struct(fields))
                }
            },
        }
    }

    /// `timeseries`: its data and its time; an even time is stored as start and step.
    fn series(&mut self, path: &str, properties: &Properties<'a>) -> Option<Array> {
        let own = |name: &str| {
            properties
                .get(name)
                .and_then(|part| self.wrapper?.only(part))
                .map(|(_, properties)| properties)
        };
        // Data that Simulink wrote while it ran are in a separate storage.
        let storage = own("Storage");
        let info = own("TimeInfo").unwrap_or(Properties(Vec::new()));
        let data = properties.get("Data").or_else(|| storage.as_ref()?.get("Data"));
        let Some(Array::Numbers { shape, values }) = data else { return None };
        self.spend(2 * values.len())?;
        let mut times = match properties.get("Time").or_else(|| info.get("Time")) {
            Some(Array::Numbers { values, .. }) => {
                self.spend(values.len())?;
                values.clone()
            }
            _ => {
                let (start, step) =
                    (info.number("Start").unwrap_or(0.0), info.number("Increment")?);
                let rows = info
                    .number("Length")
                    .map_or_else(|| shape.first().copied().unwrap_or(0), |length| length as usize);
                (0..rows.min(values.len())).map(|k| start + step * k as f64).collect()
            }
        };
        if times.len() < 2 {
            return None;
        }
        let units = info.text("Units").unwrap_or("seconds");
        let (unit, scale) = unit_of(units).unwrap_or_else(|| {
            self.notes.push(format!("{path}: its time is in {units}, which is taken for seconds"));
            (TimeUnit::S, 1.0)
        });
        times.iter_mut().for_each(|time| *time *= scale);
        // Arrays of more than two dimensions have time in the last one, unless another is named.
        let rows = times.len();
        let first = shape.first() == Some(&rows)
            && (shape.len() < 3
                || shape.last() != Some(&rows)
                || properties.number("IsTimeFirst") == Some(1.0));
        let data = if first || values.len() == rows || shape.last() != Some(&rows) {
            Array::Numbers { shape: shape.clone(), values: values.clone() }
        } else {
            let each = values.len() / rows;
            let turned = (0..each)
                .flat_map(|j| values.iter().skip(j).step_by(each.max(1)).copied())
                .collect();
            Array::Numbers { shape: vec![rows, each], values: turned }
        };
        let name =
            properties.text("Name").filter(|name| *name != "unnamed").unwrap_or_else(|| last(path));
        Some(Array::Struct(vec![
            ("time".to_owned(), Array::Times { values: times, unit }),
            (name.to_owned(), data),
        ]))
    }

    /// Columns and the stamps of their rows; even stamps may be stored as start and step.
    fn timetable(
        &mut self,
        path: &str,
        properties: &Properties<'a>,
        depth: usize,
    ) -> Option<Array> {
        let mut columns =
            self.columns(path, properties.get("varNames")?, properties.get("data")?, depth)?;
        let times = match properties.get("rowTimes")? {
            Array::Struct(rule) => {
                let part =
                    |name: &str| rule.iter().find(|(own, _)| own == name).map(|(_, array)| array);
                let millis = |name: &str| {
                    let (_, properties) = self.wrapper?.only(part(name)?)?;
                    properties.number("millis").or_else(|| properties.number("data"))
                };
                let step = match part("specifiedAsRate").and_then(first_number) {
                    Some(1.0) => 1e3 / first_number(part("sampleRate")?)?,
                    _ => millis("stepSize")?,
                };
                let longest = columns.iter().map(|(_, column)| size(column)).max().unwrap_or(0);
                let rows = (properties.number("numRows")? as usize).min(longest);
                let start = millis("origin").unwrap_or(0.0);
                Array::Times {
                    values: (0..rows).map(|k| start + step * k as f64).collect(),
                    unit: TimeUnit::Ms,
                }
            }
            stamps => self.taken(path, stamps, depth)?,
        };
        columns.insert(0, ("time".to_owned(), times));
        Some(Array::Struct(columns))
    }

    fn columns(
        &mut self,
        path: &str,
        names: &Array,
        data: &Array,
        depth: usize,
    ) -> Option<Vec<(String, Array)>> {
        let Array::List(data) = data else { return None };
        let mut columns = Vec::with_capacity(data.len());
        for (name, column) in texts(names).into_iter().zip(data) {
            columns.push((name.to_owned(), self.taken(&join(path, name), column, depth)?));
        }
        Some(columns)
    }

    /// The elements of a Dataset by their names; signals have their records in `Values`.
    fn dataset(&mut self, path: &str, properties: &Properties<'a>, depth: usize) -> Option<Array> {
        let wrapper = self.wrapper?;
        let storage = properties.get("Storage").and_then(|storage| wrapper.only(storage));
        // Data that Simulink streamed into the file are not in arrays.
        if storage.as_ref().is_some_and(|(class, _)| class.ends_with("MatFileDatasetStorage")) {
            return None;
        }
        let storage = storage.map(|(_, properties)| properties);
        let elements = storage.as_ref().unwrap_or(properties).get("Elements")?;
        let elements = if let Array::List(elements) = elements {
            elements.as_slice()
        } else {
            std::slice::from_ref(elements)
        };
        let mut found: Vec<(String, Array)> = Vec::with_capacity(elements.len());
        for (k, element) in elements.iter().enumerate() {
            let own = match element {
                Array::Struct(fields) => Properties(
                    fields
                        .iter()
                        .map(|(name, array)| (name.as_str(), Cow::Borrowed(array)))
                        .collect(),
                ),
                reference => wrapper
                    .only(reference)
                    .map_or(Properties(Vec::new()), |(_, properties)| properties),
            };
            let name =
                own.text("Name").map_or_else(|| format!("element[{}]", k + 1), ToOwned::to_owned);
            let name = if found.iter().any(|(other, _)| *other == name) {
                format!("{name}[{}]", k + 1)
            } else {
                name
            };
            let value =
                self.taken(&join(path, &name), own.get("Values").unwrap_or(element), depth)?;
            found.push((name, value));
        }
        Some(Array::Struct(found))
    }
}

/// A unit of time by MATLAB's word for it, and how many of it the word means.
fn unit_of(word: &str) -> Option<(TimeUnit, f64)> {
    Some(match word {
        "nanoseconds" => (TimeUnit::Ns, 1.0),
        "microseconds" => (TimeUnit::Us, 1.0),
        "milliseconds" => (TimeUnit::Ms, 1.0),
        "seconds" => (TimeUnit::S, 1.0),
        "minutes" => (TimeUnit::S, 60.0),
        "hours" => (TimeUnit::S, 3600.0),
        "days" => (TimeUnit::S, 86_400.0),
        "weeks" => (TimeUnit::S, 604_800.0),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(values: &[f64]) -> Array {
        Array::Numbers { shape: vec![values.len(), 1], values: values.to_vec() }
    }

    fn reference(id: f64) -> Array {
        numbers(&[MARK, 2.0, 1.0, 1.0, id, 1.0])
    }

    /// A wrapper of one object of a class, with one property.
    fn cells(class: &str, property: &str, value: Array) -> Vec<Array> {
        let mut names = format!("{class}\0{property}\0").into_bytes();
        names.resize(names.len().next_multiple_of(4), 0);
        let classes = [0, 0, 0, 0, 0, 1, 0, 0_u32];
        let objects = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 1_u32];
        let plain = [0, 0, 1, 2, 1, 0_u32];
        let mut begins = vec![40 + names.len()];
        for words in [classes.len(), 0, objects.len(), plain.len(), 0, 0, 0] {
            begins.push(begins.last().unwrap() + 4 * words);
        }
        let head =
            [4_u32, 2].into_iter().chain(begins.into_iter().map(|at| u32::try_from(at).unwrap()));
        let mut bytes: Vec<u8> = head.flat_map(u32::to_le_bytes).collect();
        bytes.extend(names);
        bytes.extend(
            classes.iter().chain(&objects).chain(&plain).copied().flat_map(u32::to_le_bytes),
        );
        let metadata: Vec<f64> = bytes.into_iter().map(f64::from).collect();
        vec![
            numbers(&metadata),
            Array::Other,
            value,
            Array::Other,
            numbers(&[0.0]),
            Array::List(Vec::new()),
        ]
    }

    fn resolved(cells: Option<Vec<Array>>) -> (Array, crate::notes::Notes) {
        let Array::Numbers { values, .. } = reference(1.0) else { unreachable!() };
        let (mut variables, mut notes) =
            (vec![("x".to_owned(), Array::Object(values))], crate::notes::Notes::default());
        resolve(&mut variables, cells, &mut notes);
        (variables.pop().unwrap().1, notes)
    }

    #[test]
    fn properties_of_an_object_are_the_fields_of_a_struct() {
        let (found, notes) = resolved(Some(cells("Thing", "time", numbers(&[0.0, 1.0]))));
        let Array::Struct(fields) = found else { panic!("{found:?}") };
        assert!(
            matches!(fields.as_slice(), [(name, Array::Numbers { .. })] if name == "time")
                && notes.is_empty(),
            "{fields:?} {notes:?}"
        );
    }

    #[test]
    fn objects_that_hold_themselves_come_to_an_end_and_are_said() {
        let many = Array::List(vec![reference(1.0); 40]);
        for (class, property) in [
            ("Thing", "inner"),
            ("Simulink.SimulationData.Dataset", "Elements"),
            ("Simulink.SimulationData.Signal", "Values"),
        ] {
            for value in [reference(1.0), many.clone()] {
                let (found, notes) = resolved(Some(cells(class, property, value)));
                assert!(
                    size(&found) < 50_000 && !notes.is_empty() && notes.len() < 5_000,
                    "{class}: {} {}",
                    size(&found),
                    notes.len()
                );
            }
        }
    }

    #[test]
    fn objects_without_what_they_hold_are_named() {
        let damaged = |at: usize, value: f64| {
            let mut cells = cells("Thing", "time", numbers(&[0.0, 1.0]));
            if let Some(Array::Numbers { values, .. }) = cells.first_mut() {
                values[at] = value;
            }
            Some(cells)
        };
        for cells in
            [None, Some(Vec::new()), damaged(0, 9.0), damaged(8, 255.0), damaged(20, 255.0)]
        {
            let (_, notes) = resolved(cells);
            assert!(notes.len() == 1 && notes[0].starts_with("x: "), "{notes:?}");
        }
    }
}
