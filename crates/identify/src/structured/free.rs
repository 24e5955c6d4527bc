//! Candidates for free parameters: the parameters of the equations, then the dead time of each input.

use super::error::StructuredError;
use crate::error::Result;
use deadtime_model::EquationsFile;

/// The name of the dead time of an input.
pub(crate) fn delay_name(input: &str) -> String {
    format!("delay:{input}")
}

/// A parameter of the equations, or a dead time.
#[derive(Debug, Clone)]
pub(super) struct Quantity {
    pub(super) name: String,
    pub(super) unit: Option<String>,
    /// The file's value.
    pub(super) nominal: f64,
}

/// All quantities of a model: its parameters, then the dead time of each input.
pub(super) fn quantities(file: &EquationsFile) -> Vec<Quantity> {
    let parameter = |(name, entry): &(String, deadtime_model::ParameterEntry)| Quantity {
        name: name.clone(),
        unit: entry.unit.clone(),
        nominal: entry.value,
    };
    let delay = |(i, input): (usize, &deadtime_model::Channel)| Quantity {
        name: delay_name(&input.name),
        unit: Some("s".to_owned()),
        nominal: file.input_delay_s.get(i).copied().unwrap_or(0.0),
    };
    let parameters = file.parameters.iter().map(parameter);
    parameters.chain(file.inputs.iter().enumerate().map(delay)).collect()
}

/// For each input, the input whose dead time applies to it: its own; for a slope, that of the input whose slope it is.
pub(super) fn leaders(file: &EquationsFile) -> Vec<usize> {
    let at = |name: &String| file.inputs.iter().position(|c| c.name == *name);
    let leader = |(i, c): (usize, &deadtime_model::Channel)| {
        c.derivative_of.as_ref().and_then(at).unwrap_or(i)
    };
    file.inputs.iter().enumerate().map(leader).collect()
}

/// The named quantities; for `all` the parameters not marked as known and the dead times.
pub(super) fn indices(
    file: &EquationsFile,
    quantities: &[Quantity],
    names: &[String],
) -> Result<Vec<usize>> {
    let count = file.parameters.len();
    let own = |i: &usize| *i < count || file.inputs[*i - count].derivative_of.is_none();
    let every = || (0..quantities.len()).filter(own);
    let find = |name: &String| {
        let known = || every().map(|i| quantities[i].name.clone()).collect();
        let at = every().find(|&i| quantities[i].name == *name);
        at.ok_or_else(|| StructuredError::NoParameter { name: name.clone(), known: known() }.into())
    };
    let single = names.iter().filter(|name| *name != "all");
    let mut found: Vec<usize> = single.map(find).collect::<Result<_>>()?;
    if names.iter().any(|name| name == "all") {
        found.extend(every().filter(|&i| i >= count || !file.parameters[i].1.known));
    }
    found.sort_unstable();
    found.dedup();
    Ok(found)
}

/// The model with the fitted values by name. An input that is another's slope keeps its offset from that input's dead time.
pub(super) fn with_values(file: &EquationsFile, found: &[(String, f64)]) -> EquationsFile {
    let mut model = file.clone();
    let value = |name: &str| found.iter().find(|(own, _)| own == name).map(|(_, value)| *value);
    for (name, entry) in &mut model.parameters {
        entry.value = value(name).unwrap_or(entry.value);
    }
    for (i, leader) in leaders(file).into_iter().enumerate() {
        if let Some(delay_s) = value(&delay_name(&file.inputs[leader].name)) {
            let nominal_s = file.input_delay_s.get(leader).copied().unwrap_or(0.0);
            model.input_delay_s.resize(file.inputs.len(), 0.0);
            let to = &mut model.input_delay_s[i];
            *to = if leader == i { delay_s } else { *to + delay_s - nominal_s };
            *to = to.max(0.0);
        }
    }
    model
}
