//! A diagnosis as a page: where the gap is, which causes take how much of it, how far it shrinks, what to do next.

use maud::{Markup, html};
use serde_json::{Value, json};

use super::bars::{bar, dot, stretch};
use super::frame::{Cell, figure, named, number, page, percent, plots, quoted, table};
use super::series::{Thinning, base64};
use super::{force, laws, residual};
use crate::report::diagnosis::{Line, base, caveat_lines, lines, others, sure, values};
use crate::report::facts::{Cause, Label, Ranked, acts, probability, recalibrated};
use deadtime_gap::{
    CauseClass, CommandTrace, Contribution, Diagnosed, Diagnosis, FoundEffect, FoundParameter,
    HorizonError, Mode, RankingRow, Share, Strength, Trace, in_words, listed,
};

/// Logs that the page holds.
const LOGS: usize = 40;
/// Rows of the ranking that are shown open.
const OPEN_ROWS: usize = 12;
/// A prediction may leave the range of the measurement by this many of its widths before it is cut off. A diverging prediction must not flatten the other
/// curves.
const LEAVES: f64 = 1.0;

/// The page.
#[must_use]
pub fn gap(diagnosed: &Diagnosed) -> String {
    let d = &diagnosed.diagnosis;
    let verdict = match d.cause.effects.as_slice() {
        [] => d.cause.verdict.clone(),
        found => {
            let name = |e: &FoundEffect| in_words(&e.effect, &e.channel).replace('`', "");
            listed(&found.iter().map(name).collect::<Vec<_>>())
        }
    };
    let (mut figures, laws, next) =
        (residual::figures(diagnosed), laws::figure(diagnosed), experiment(diagnosed));
    let missing = force::figure(diagnosed.missing_force.as_ref());
    figures.extend(laws.iter().chain(&missing).cloned());
    figures.extend(next.iter().map(|(figure, _)| figure.clone()));
    let body = html! {
        h1 { "Sim-to-real gap of " (d.model) }
        @for line in lines(diagnosed).iter().filter(|line| line.label == Label::First) { (sentence(line)) }
        (tiles(d))
        @for line in lines(diagnosed).iter().filter(|line| line.label == Label::Cause) { (sentence(line)) }
        (curves(diagnosed))
        details {
            summary { "All sentences" }
            @for line in lines(diagnosed).iter().chain(&caveat_lines(diagnosed)) { (sentence(line)) }
        }
        (budget(d))
        (parameters(d))
        @if laws.is_some() {
            h3 { "Each effect as itself" }
            (figure("laws", "The effect"))
        }
        @if missing.is_some() {
            h3 { "The residual, as a missing force" }
            p { "Fitted to the residual, with the 95 % interval of its noise, and the simplest law that comes near it. It is a description, not a cause." }
            (figure("missing", "The force"))
        }
        (candidates(d))
        @if let Some(next_text) = &d.cause.next_experiment {
            h2 { "Next experiment" }
            div .next { p { (quoted(next_text)) } }
            @if let Some((_, file)) = &next {
                p { "The commands, scaled from those of the first training log. Keep them within the limits of the machine." }
                (figure("experiment", "The commands"))
                p { a href=(file) download="next_experiment.csv" { "The experiment as CSV" } }
            }
        }
        (size(d))
        (place(d))
        (sides(&residual::ids(&figures)))
        (checks(d))
        (origin(d))
    };
    page(&format!("Gap of {}: {verdict}", d.model), &body, &data(diagnosed, &figures))
}

fn sentence(line: &Line) -> Markup {
    html! { p { strong { (line.label.word()) ":" } " " (quoted(&line.text)) } }
}

/// The answer at a glance: the error before and after, the cause, its probability, the residual.
fn tiles(d: &Diagnosis) -> Markup {
    let tile = |title: &str, value: &str, about: &str| {
        html! { div .tile { span .faint { (title) } strong { (value) } span { (about) } } }
    };
    let error = match (d.shrink.before, d.shrink.after.filter(|_| acts(d))) {
        (Some(before), Some(after)) => {
            format!("{} → {}", percent(Some(before)), percent(Some(after)))
        }
        (before, _) => percent(before),
    };
    let first = d.cause.classes.first();
    let (cause, about) = match (d.cause.effects.as_slice(), first) {
        (_, Some(class)) => {
            let more = d.cause.classes.len() - 1;
            let own =
                |c: &&Contribution| class.representative == format!("{}:{}", c.effect, c.channel);
            let more = match d.cause.contributions.iter().find(own) {
                _ if more > 0 => format!("and {more} more"),
                Some(one) => values(&one.parameters),
                None => String::new(),
            };
            (class.name.replace('`', ""), more)
        }
        _ => (d.cause.verdict.clone(), String::new()),
    };
    let sure_of = sure(first.map_or_else(|| probability(d), |class| class.probability));
    let of_what = match Cause::of(d) {
        Cause::NothingMoves | Cause::None => "that no effect of the catalogue acts",
        Cause::Unknown => "that no effect of the catalogue explains the gap",
        _ => "that it or an alias acts",
    };
    let left = d.cause.remainder.as_ref().and_then(|r| r.above_floor);
    let left = left.map_or_else(|| "–".to_owned(), |times| format!("{times:.1} × noise"));
    html! {
        div .tiles {
            (tile("Error on held-out data", &error, "of the standard deviation"))
            (tile("Cause", &cause, &about))
            (tile("Probability", &sure_of, of_what))
            (tile("Residual", &left, "on the training logs"))
        }
    }
}

/// The plots' place, and what their colours mean.
fn curves(diagnosed: &Diagnosed) -> Markup {
    let with = diagnosed.traces.iter().any(|t| t.after.is_some());
    let logs = logs(diagnosed);
    html! {
        h2 { "Where: measured and simulated" }
        @if diagnosed.traces.is_empty() {
            p { "The model could not be simulated for a picture." }
        } @else {
            p {
                span .key.measured { "measured" }
                span .key.before { "simulated" }
                @if with { span .key.after { "simulated with the causes found" } }
                span .key.input { "commands" }
                span .key.area.floor { "noise floor, ± one standard deviation" }
                span .key.area.held { "held out" }
                span .key.span { "span with most of the gap" }
            }
            (plots("The curves"))
            @if logs.len() > LOGS { p .faint { "The first " (LOGS) " of " (logs.len()) " logs." } }
        }
    }
}

/// The residual from four sides.
fn sides(there: &std::collections::BTreeSet<&str>) -> Markup {
    html! {
        @if there.contains("regimes") {
            h3 { "Against what the machine does" }
            p { "Where a curve rises, the gap grows with the variable; a step at zero speaks of friction or a dead band." }
            (figure("regimes", "The picture"))
        }
        @if there.contains("map") {
            h3 { "Over time and frequency" }
            p { "Colour is how far the residual is above a white noise of the floor's size: none below 6 dB, full at 40 dB. Dots mark the strongest frequency." }
            (figure("map", "The map"))
        }
        @if there.contains("spectrum") {
            h3 { "Spectrum" }
            (figure("spectrum", "The spectrum"))
        }
        @if there.contains("coherence") {
            h3 { "Coherence with the commands" }
            p { "Near 1, a better linear model would still explain the residual there. What goes with no command is noise, a disturbance, or nonlinear." }
            (figure("coherence", "The coherence"))
        }
    }
}

/// The proposed experiment's commands, and the same as a CSV in a link.
fn experiment(diagnosed: &Diagnosed) -> Option<(Value, String)> {
    let proposed = diagnosed.next_experiment.as_ref()?;
    let count = logs(diagnosed).len();
    let inputs = diagnosed.commands.len().checked_div(count)?;
    let at = diagnosed.traces.iter().take(count).position(|t| t.train.is_some())?;
    let commands = diagnosed.commands.get(at * inputs..(at + 1) * inputs)?;
    let logged: Vec<Vec<f64>> = commands.iter().map(|c| c.values.clone()).collect();
    let planned = proposed.commands(&logged)?;
    let time_s: Vec<f64> =
        diagnosed.traces.get(at)?.time_s.iter().take(planned.first()?.len()).copied().collect();
    let cell = |name: &str| {
        if name.contains([',', '"', '\n', '\r']) {
            format!("\"{}\"", name.replace('"', "\"\""))
        } else {
            name.to_owned()
        }
    };
    let heading = |c: &CommandTrace| {
        cell(&c.unit.as_deref().map_or_else(|| c.input.clone(), |u| format!("{} [{u}]", c.input)))
    };
    let mut csv = std::iter::once("time [s]".to_owned())
        .chain(commands.iter().map(heading))
        .collect::<Vec<_>>()
        .join(",")
        + "\n";
    for (k, t) in time_s.iter().enumerate() {
        let row: Vec<String> = std::iter::once(*t)
            .chain(planned.iter().filter_map(|u| u.get(k).copied()))
            .map(|v| v.to_string())
            .collect();
        csv += &(row.join(",") + "\n");
    }
    let view = |(c, u): (&CommandTrace, &Vec<f64>)| {
        let logged: Vec<f64> = c.values.iter().take(u.len()).copied().collect();
        json!({
            "kind": "lines", "keys": [c.input], "about": format!("Proposed command {} over time", c.input), "height": 260,
            "x": { "label": "time (s)", "values": time_s, "tight": true },
            "y": { "label": if unit(c.unit.as_deref()).is_empty() { c.input.clone() } else { format!("{} ({})", c.input, unit(c.unit.as_deref())) } },
            "curves": [
                { "label": "logged", "y": logged, "color": "measured", "held": true, "points": false },
                { "label": "proposed", "y": u, "color": "input", "held": true, "points": false, "width": 1.8 },
            ],
        })
    };
    let views: Vec<Value> = commands.iter().zip(&planned).map(view).collect();
    Some((
        json!({ "id": "experiment", "pick": ["command"], "views": views }),
        format!("data:text/csv;base64,{}", base64(csv.bytes())),
    ))
}

/// The names of the logs that have curves, in order.
fn logs(diagnosed: &Diagnosed) -> Vec<&str> {
    let Some(first) = diagnosed.traces.first() else { return Vec::new() };
    diagnosed
        .traces
        .iter()
        .take_while(|t| t.output == first.output)
        .map(|t| t.log.as_str())
        .collect()
}

/// The data of the script.
fn data(diagnosed: &Diagnosed, figures: &[Value]) -> Value {
    let d = &diagnosed.diagnosis;
    let count = logs(diagnosed).len();
    let shown = count.min(LOGS);
    let outputs = diagnosed.traces.len().checked_div(count).unwrap_or(0);
    let inputs = diagnosed.commands.len().checked_div(count).unwrap_or(0);
    let curves = 3 * outputs + inputs;
    let samples: usize = diagnosed.traces.iter().take(shown).map(|t| t.time_s.len()).sum();
    let log = |at: usize| {
        let of: Vec<&Trace> =
            (0..outputs).filter_map(|i| diagnosed.traces.get(i * count + at)).collect();
        let commands: Vec<&CommandTrace> =
            diagnosed.commands.iter().skip(at * inputs).take(inputs).collect();
        let first = *of.first()?;
        let thinning = Thinning::share(&first.time_s, curves, samples);
        let outputs: Vec<Value> = of.iter().map(|t| output(t, thinning, d)).collect();
        let inputs: Vec<Value> = commands.iter().map(|c| command(c, thinning)).collect();
        let time = thinning.times(&first.time_s);
        Some(
            json!({ "name": first.log, "bucket": thinning.bucket(), "time": time, "held": first.held, "outputs": outputs, "inputs": inputs }),
        )
    };
    let all: Vec<Value> = (0..shown).filter_map(log).collect();
    let densest = d.place.times.first().map(|t| t.log.as_str());
    let opens = logs(diagnosed).iter().take(shown).position(|l| Some(*l) == densest).unwrap_or(0);
    json!({ "kind": "gap", "logs": all, "opens": opens, "figures": figures })
}

fn output(t: &Trace, thinning: Thinning, d: &Diagnosis) -> Value {
    let range = t.measured.iter().flatten().filter(|v| v.is_finite());
    let [low, high] = range
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(*v), high.max(*v)]);
    let beyond = (LEAVES * (high - low)).max(t.floor);
    let within = if low <= high {
        [low - beyond, high + beyond]
    } else {
        [f64::NEG_INFINITY, f64::INFINITY]
    };
    let of = |values: &[f64]| thinning.curve(|i| values.get(i).copied(), within);
    let spans: Vec<[f64; 2]> = d
        .place
        .times
        .iter()
        .filter(|s| s.log == t.log && s.output == t.output)
        .map(|s| [s.from_s, s.to_s])
        .collect();
    json!({
        "name": t.output,
        "unit": unit(t.unit.as_deref()),
        "floor": if t.floor.is_finite() { t.floor } else { 0.0 },
        "measured": thinning.curve(|i| t.measured.get(i).copied().flatten(), within),
        "before": of(&t.before),
        "after": t.after.as_deref().map(of),
        "spans": spans,
    })
}

fn command(c: &CommandTrace, thinning: Thinning) -> Value {
    let all = [f64::NEG_INFINITY, f64::INFINITY];
    json!({ "name": c.input, "unit": unit(c.unit.as_deref()), "values": thinning.curve(|i| c.values.get(i).copied(), all) })
}

fn unit(unit: Option<&str>) -> &str {
    unit.filter(|u| *u != "1").unwrap_or("")
}

/// A row of the budget: its name, its shares, its part of the squared error.
fn takes(what: &str, [learnt, held]: [String; 2], label: &str, drawn: &Markup) -> Vec<Cell> {
    vec![
        Cell::Words(what.to_owned()),
        Cell::Number(learnt),
        Cell::Number(held),
        Cell::Drawn(bar(label, drawn)),
    ]
}

/// The waterfall of squared errors: nominal, each contribution, residual, noise; `noise` is the floor's part of it.
fn waterfall(d: &Diagnosis, noise: f64) -> Vec<Vec<Cell>> {
    let shares = |share: &Share| [percent(share.learnt), percent(share.held_out)];
    let mut top = 1.0;
    let whole = stretch(0.0, 1.0, "before");
    let shown = [percent(Some(1.0)), String::new()];
    let mut rows = vec![takes("simulated as it came", shown, "all of the squared error", &whole)];
    let block = recalibrated(d).map(|r| ("parameters recalibrated".to_owned(), r.share));
    let causes =
        d.cause.contributions.iter().map(|c| (format!("{} on {}", c.effect, c.channel), c.share));
    for (name, share) in causes.chain(block) {
        let part = share.learnt.unwrap_or(0.0) * (1.0 - noise);
        let label = format!("{name} takes {} of the squared error", percent(Some(part)));
        let drawn = stretch(top - part, top, "after");
        rows.push(takes(&format!("− {name}"), shares(&share), &label, &drawn));
        top -= part;
    }
    if let Some(rest) = &d.cause.remainder {
        let label = format!("residual above the noise: {} of the gap", percent(rest.share.learnt));
        let drawn = stretch(noise.min(top), top, "rest");
        rows.push(takes("residual", shares(&rest.share), &label, &drawn));
    }
    let dashes = ["–", "–"].map(str::to_owned);
    let drawn = stretch(0.0, noise, "noise");
    rows.push(takes("noise floor", dashes, "noise that no model can explain", &drawn));
    rows
}

/// The shares of the gap.
fn budget(d: &Diagnosis) -> Markup {
    let found = acts(d);
    let (Some(before), Some(floor), true) = (d.gap.before, d.gap.floor, found) else {
        return html! {};
    };
    let noise = if before > 0.0 { (floor / before).powi(2).min(1.0) } else { 0.0 };
    let left = d.cause.remainder.as_ref().and_then(|r| r.above_floor);
    html! {
        h2 { "Which: the budget of the gap" }
        p { "The error falls from " (percent(Some(before))) " of the spread; the noise floor is " (percent(Some(floor))) ". Shares are of the gap between the two, in squared error." }
        (table("From the nominal model down to the noise", &["what", "share, training logs", "held out", "squared error"], &waterfall(d, noise)))
        @if let Some(times) = left { p { (format!("The residual is {times:.1} times the noise floor.")) } }
        @if d.shrink.decoded.is_some() {
            p {
                "These shares are taken once it is known which commands were lost or late. A simulation, which cannot know it, gains "
                (percent(d.shrink.of_explainable)) " of the gap on held-out data."
            }
        }
    }
}

/// A row of the parameters.
fn parameter([effect, channel, clear]: [&str; 3], p: &FoundParameter) -> Vec<Cell> {
    let interval = match (p.value, p.ci95) {
        (None, _) => "–".to_owned(),
        (_, None) => "at a bound".to_owned(),
        (_, Some(ends)) => ends.map(|v| number(Some(v))).join(" to "),
    };
    let value = if p.value.is_some() { number(p.value) } else { "no limit".to_owned() };
    let label = format!("{value}, {interval}");
    vec![
        Cell::Words(effect.to_owned()),
        Cell::Words(channel.to_owned()),
        Cell::Words(p.name.clone()),
        Cell::Number(value),
        Cell::Number(interval),
        Cell::Words(p.unit.clone()),
        Cell::Drawn(bar(&label, &beside_zero(p))),
        Cell::Words(clear.to_owned()),
    ]
}

/// Each parameter with its interval on an axis that holds zero.
fn parameters(d: &Diagnosis) -> Markup {
    if !acts(d) {
        return html! {};
    }
    let clear = |c: &Contribution| match (c.strength, c.surrogate) {
        (_, true) => "predicts, not the physics' value",
        (Strength::Clear, _) => "clear",
        (Strength::Weak, _) => "weak",
    };
    let found = d.cause.contributions.iter().flat_map(|c| {
        let about = [&c.effect, &c.channel, clear(c)];
        c.parameters.iter().map(move |p| parameter(about, p))
    });
    let block = recalibrated(d)
        .into_iter()
        .flat_map(|r| &r.parameters)
        .map(|p| parameter(["recalibrated", "", "a part of a set"], p));
    let rows: Vec<Vec<Cell>> = found.chain(block).collect();
    let caption = if d.cause.effects.is_empty() {
        "What contributes, though not all is explained"
    } else {
        "What was found to act"
    };
    let headings = [
        "effect",
        "channel",
        "parameter",
        "value",
        "95 % interval",
        "unit",
        "from zero",
        "how clear",
    ];
    html! {
        h2 { "Parameters" }
        (table(caption, &headings, &rows))
        @for direction in recalibrated(d).iter().flat_map(|r| &r.directions) { p { (direction) "." } }
    }
}

/// A value and its interval on an axis that holds zero.
fn beside_zero(p: &FoundParameter) -> Markup {
    let Some(value) = p.value else { return html! {} };
    let [low, high] = p.ci95.unwrap_or([value, value]);
    let (from, to) = (low.min(value).min(0.0), high.max(value).max(0.0));
    let at = |v: f64| (v - from) / (to - from);
    html! { (stretch(at(0.0) - 0.002, at(0.0) + 0.002, "noise")) (stretch(at(low), at(high), "range")) (dot(at(value), "")) }
}

/// Base names of files.
fn names(all: &[String]) -> Markup {
    let base = |name: &String| {
        let path = std::path::Path::new(name);
        path.file_name().map_or_else(|| name.clone(), |n| n.to_string_lossy().into_owned())
    };
    html! { @for (at, name) in all.iter().enumerate() { @if at > 0 { ", " } code { (base(name)) } } }
}

/// The classes of causes, then every candidate with its residual error alone, and the untried ones.
fn candidates(d: &Diagnosis) -> Markup {
    let class = |class: &CauseClass| {
        let label = format!("probability {}", sure(class.probability));
        vec![
            Cell::Words(class.name.replace('`', "")),
            Cell::Number(percent(class.share.learnt)),
            Cell::Number(sure(class.probability)),
            Cell::Drawn(bar(&label, &stretch(0.0, class.probability, "after"))),
            Cell::Words(others(class).join(", ").replace('`', "")),
        ]
    };
    let classes: Vec<Vec<Cell>> = d.cause.classes.iter().map(class).collect();
    let candidate = |row: &RankingRow| {
        let row = Ranked::of(row);
        let [effect, channel] = row.cells();
        row.after?;
        Some(vec![
            Cell::Words(effect),
            Cell::Words(named(&channel).to_owned()),
            Cell::Number(percent(row.after)),
        ])
    };
    let mut rows: Vec<(f64, Vec<Cell>)> = d
        .cause
        .ranking
        .iter()
        .filter_map(|row| Some((Ranked::of(row).after?, candidate(row)?)))
        .collect();
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let rows: Vec<Vec<Cell>> = rows.into_iter().map(|row| row.1).collect();
    let (open, rest) = rows.split_at(rows.len().min(OPEN_ROWS));
    let headings = ["effect", "channel", "error with it alone"];
    html! {
        h2 { "Candidates" }
        @if !classes.is_empty() {
            (table("Causes; the probability is that the effect or one of its aliases acts", &["cause", "explains", "probability", "", "aliases"], &classes))
        }
        (table("Each candidate alone; the error is in parts of the standard deviation, on the training logs", &headings, open))
        @if !rest.is_empty() {
            details { summary { (rest.len()) " more candidates" } (table("Each candidate alone, continued", &headings, rest)) }
        }
        @if !d.cause.not_tried.is_empty() {
            p { "Not tried, by reason:" }
            ul .faint { @for (why, effects) in not_tried(d) { li { (quoted(why)) ": " @for (at, effect) in effects.iter().enumerate() { @if at > 0 { ", " } code { (effect) } } } } }
        }
    }
}

/// The effects that were not tried, by the reason.
fn not_tried(d: &Diagnosis) -> Vec<(&str, Vec<&str>)> {
    let mut reasons: Vec<(&str, Vec<&str>)> = Vec::new();
    for n in &d.cause.not_tried {
        match reasons.iter_mut().find(|(why, _)| *why == n.why) {
            Some((_, effects)) => effects.push(&n.effect),
            None => reasons.push((&n.why, vec![&n.effect])),
        }
    }
    reasons
}

/// Every output, and all together: the gap on the training logs, the error on held-out data before, after and as noise.
fn outputs(d: &Diagnosis, after: &dyn Fn(Option<f64>) -> String) -> Vec<Vec<Cell>> {
    let s = &d.shrink;
    let found = acts(d);
    let errors = s.outputs.iter().flat_map(|o| [o.before, o.after]).chain([s.before, s.after]);
    let most = errors.flatten().filter(|v| v.is_finite()).fold(1e-9, f64::max);
    let at = |v: Option<f64>| v.unwrap_or(0.0) / most;
    let row = |name: &str, share: Option<f64>, gap: [Option<f64>; 2], held: [Option<f64>; 3]| {
        let [before, rest, floor] = held;
        let shown = [percent(before), after(rest), percent(floor)];
        let [b, a, f] = &shown;
        let label = format!("held out: {b} before, {a} after, floor {f}");
        let drawn = html! {
            (stretch(0.0, at(before), "before"))
            @if found { (stretch(0.0, at(rest), "after")) }
            (stretch(at(floor) - 0.003, at(floor) + 0.003, "noise"))
        };
        let mut cells = vec![Cell::Words(name.to_owned()), Cell::Number(percent(share))];
        cells.extend(gap.map(|v| Cell::Number(percent(v))));
        cells.extend(shown.map(Cell::Number));
        cells.push(Cell::Drawn(bar(&label, &drawn)));
        cells
    };
    let each = d.gap.outputs.iter().zip(&s.outputs);
    let mut rows: Vec<Vec<Cell>> = each
        .map(|(g, o)| row(&g.name, g.share, [g.before, g.floor], [o.before, o.after, o.floor]))
        .collect();
    if rows.len() > 1 {
        rows.push(row("together", None, [d.gap.before, d.gap.floor], [s.before, s.after, s.floor]));
    }
    rows
}

/// How big, and how far it shrinks.
fn size(d: &Diagnosis) -> Markup {
    let found = acts(d);
    let after = |v: Option<f64>| if found { percent(v) } else { "–".to_owned() };
    let s = &d.shrink;
    let headings = [
        "output",
        "share of the gap",
        "training: error",
        "floor",
        "held out: before",
        "after",
        "floor",
        "before, after and floor",
    ];
    html! {
        h2 { "How far: error before and after" }
        (table("Root mean square error of predictions in parts of the output's standard deviation; the floor is the noise", &headings, &outputs(d, &after)))
        @if let (true, Some(_)) = (found, s.fraction) {
            p {
                "Shrink on held-out data: " (percent(s.fraction))
                @if let Some([l, u]) = s.ci95 { " (95 %: " (percent(Some(l))) " to " (percent(Some(u))) ")" }
                @if let Some(of) = s.of_explainable { ", " (percent(Some(of))) " of what can be explained" }
                "."
            }
        }
        @if !s.horizons.is_empty() {
            (table(
                "Held-out error by the samples since a prediction began, in parts of the spread",
                &["samples ahead", "before", "after", ""],
                &s.horizons.iter().map(horizon).collect::<Vec<_>>(),
            ))
        }
    }
}

/// The errors so many samples ahead.
fn horizon(error: &HorizonError) -> Vec<Cell> {
    let drawn = bar(
        &format!("{} and {}", percent(error.before), percent(error.after)),
        &html! { (stretch(0.0, error.before.unwrap_or(0.0).min(1.0), "before")) (stretch(0.0, error.after.unwrap_or(0.0).min(1.0), "after")) },
    );
    let [before, after] = [error.before, error.after].map(|v| Cell::Number(number(v)));
    vec![Cell::Number(error.samples.to_string()), before, after, Cell::Drawn(drawn)]
}

fn place(d: &Diagnosis) -> Markup {
    let w = &d.place;
    let row = |output: &str, what: String, [from, to]: [f64; 2], share: f64| {
        let drawn = bar(&percent(Some(share)), &stretch(0.0, share, "before"));
        let [from, to] = [from, to].map(|v| Cell::Number(number(Some(v))));
        vec![
            Cell::Words(output.to_owned()),
            Cell::Words(what),
            from,
            to,
            Cell::Number(percent(Some(share))),
            Cell::Drawn(drawn),
        ]
    };
    let times = w.times.iter().map(|t| {
        row(&t.output, format!("time (s), {}", base(&t.log)), [t.from_s, t.to_s], t.share)
    });
    let bands = w
        .bands
        .iter()
        .map(|b| row(&b.output, "frequency (Hz)".to_owned(), [b.from_hz, b.to_hz], b.share));
    let regimes =
        w.regimes.iter().map(|r| row(&r.output, r.variable.clone(), [r.from, r.to], r.share));
    let rows: Vec<Vec<Cell>> = times.chain(bands).chain(regimes).collect();
    let caption = "Where the error above the floor is most dense; shares are of the output's own";
    html! { @if !rows.is_empty() { h2 { "Where: times, bands and regimes" } (table(caption, &["output", "in", "from", "to", "share", ""], &rows)) } }
}

fn checks(d: &Diagnosis) -> Markup {
    let rows: Vec<Vec<Cell>> = d
        .checks
        .iter()
        .map(|check| {
            let name = check.check.name().replace('_', " ");
            let passed = check.ok.map_or("cannot be tested", |ok| if ok { "yes" } else { "no" });
            let mut cells: Vec<Cell> =
                [name, named(&check.channel).to_owned(), passed.to_owned()].map(Cell::Words).into();
            cells.push(Cell::Marked(quoted(&check.finding.to_string())));
            cells
        })
        .collect();
    html! { @if !rows.is_empty() { h2 { "Checks" } (table("Checks that run before the model", &["check", "channel", "passed", "finding"], &rows)) } }
}

fn origin(d: &Diagnosis) -> Markup {
    let mode = match d.prediction.mode {
        Mode::Simulation => "a free run of the model from the most likely start of each log",
        Mode::Predictor => "one-step predictions of a fixed observer",
        Mode::Horizon => {
            "free runs of the model over a horizon, each from the state that a fixed observer has estimated there"
        }
    };
    let held = |h: &deadtime_gap::Holdout| {
        vec![
            Cell::Words(base(&h.log).to_owned()),
            Cell::Number(number(Some(h.from_s))),
            Cell::Number(number(Some(h.to_s))),
        ]
    };
    let rows: Vec<Vec<Cell>> = d.holdout.iter().map(held).collect();
    html! {
        h2 { "Data" }
        p { "Training logs: " (names(&d.logs)) ". Simulated means " (mode) ": " (d.prediction.why) "." }
        (table("The held-out data that the shrink is measured on", &["log", "from (s)", "to (s)"], &rows))
    }
}
