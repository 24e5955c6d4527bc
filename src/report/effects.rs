//! The effects there are, as a table for people and as data.

use serde::Serialize;
use serde_json::{Value, json};

use super::text::Table;
use deadtime_model::effect::{Applied, Line, Parameter, Site};
use deadtime_model::simulate::System;

/// A parameter as data; a limit that does not act is null.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParameterRow {
    /// Its name.
    pub name: std::borrow::Cow<'static, str>,
    /// Its unit.
    pub unit: String,
    /// Where the effect is the identity.
    pub nominal: Option<f64>,
    /// The smallest value.
    pub lower: Option<f64>,
    /// The largest value.
    pub upper: Option<f64>,
}

/// An effect on a channel of a model, as data.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Where it acts.
    pub site: Site,
    /// Its name.
    pub effect: &'static str,
    /// The channel.
    pub channel: String,
    /// Its parameters there.
    pub parameters: Vec<ParameterRow>,
}

/// The table of all effects, in Markdown.
#[must_use]
pub fn lines_text(lines: &[Line]) -> String {
    let mut table =
        Table::new(&["acts on", "effect", "channel", "parameters", "what it is"], &[0, 1, 2, 3, 4]);
    for line in lines {
        let parameters: Vec<String> =
            line.parameters.iter().map(|p| format!("{} ({})", p.name, p.unit)).collect();
        table.marked_up_row(vec![
            line.site.name().to_owned(),
            format!("`{}`", line.effect),
            line.channels.to_owned(),
            parameters.join(", "),
            line.summary.to_owned(),
        ]);
    }
    table.markdown()
}

/// The same as data.
#[must_use]
pub fn lines_data(lines: &[Line]) -> Vec<Value> {
    let line = |line: &Line| {
        let parameters: Vec<Value> =
            line.parameters.iter().map(|p| json!({ "name": p.name, "unit": p.unit })).collect();
        json!({ "site": line.site, "effect": line.effect, "channels": line.channels, "parameters": parameters, "summary": line.summary })
    };
    lines.iter().map(line).collect()
}

/// The channels of a model on which each effect can act.
#[must_use]
pub fn menu_text(system: &System, menu: &[Applied]) -> String {
    let mut table = Table::new(
        &["acts on", "effect", "channel", "parameters and where they do nothing"],
        &[0, 1, 2, 3],
    );
    for applied in menu {
        let value = |p: &Parameter| match (p.nominal.is_finite(), p.unit.as_str()) {
            (false, unit) => format!("{} none [{unit}]", p.name),
            (true, unit) => format!("{} {} [{unit}]", p.name, p.nominal),
        };
        let parameters: Vec<String> = applied.parameters.iter().map(value).collect();
        table.row(vec![
            applied.effect.site().name().to_owned(),
            applied.effect.name().to_owned(),
            applied.channel.clone(),
            parameters.join(", "),
        ]);
    }
    let mut text = table.to_string();
    if system.is_sampled() {
        text.push_str("Effects on the dynamics need a continuous model; this one is sampled.\n");
    }
    text
}

/// The same as data.
#[must_use]
pub fn menu_data(menu: &[Applied]) -> Vec<Row> {
    let finite = |v: f64| v.is_finite().then_some(v);
    let parameter = |p: &Parameter| ParameterRow {
        name: p.name.clone(),
        unit: p.unit.clone(),
        nominal: finite(p.nominal),
        lower: finite(p.lower),
        upper: finite(p.upper),
    };
    let row = |applied: &Applied| Row {
        site: applied.effect.site(),
        effect: applied.effect.name(),
        channel: applied.channel.clone(),
        parameters: applied.parameters.iter().map(parameter).collect(),
    };
    menu.iter().map(row).collect()
}
