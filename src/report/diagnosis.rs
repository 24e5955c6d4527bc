//! The answer of a diagnosis in sentences, in the order of a reader's questions. Every face prints these.

use super::facts::{
    Cause, Label, Place, Ranked, Shrink, acts, caveats, described, first, probability,
};
use super::text::{Table, estimate, unit};
use deadtime_gap::{
    CauseClass, Diagnosed, Diagnosis, Explained, FoundEffect, FoundParameter, HorizonError, Member,
    NuisanceEstimate, in_words, listed,
};
use deadtime_signal::text::{plus_minus, shown};

/// Aliases that a sentence names; the others are counted.
const NAMED: usize = 3;
/// The residual is noise up to so many times the noise floor, as in the verdict.
const NOISE: f64 = 1.5;

/// A line of the summary.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Line {
    /// Its subject.
    pub label: Label,
    /// Its sentence.
    pub text: String,
}

/// The first fix, the cause, the reduction on held-out data, the residual, and the next experiment. Then size and place of the gap and nuisances of the model.
#[must_use]
pub fn lines(found: &Diagnosed) -> Vec<Line> {
    let d = &found.diagnosis;
    let before = first(found);
    let before = (!before.is_empty())
        .then(|| format!("fix this first; the rest may be wrong: {}.", before.join("; ")));
    let all = [
        (Label::First, before),
        (Label::Cause, Some(cause(d))),
        (Label::Shrink, Some(shrink(d))),
        (Label::Left, left(d)),
        (Label::Next, d.cause.next_experiment.clone()),
        (Label::Gap, Some(size(d))),
        (Label::Place, Some(place(d))),
        (Label::Nuisances, nuisances(d).map(|each| format!("{each}."))),
    ];
    all.into_iter().filter_map(|(label, text)| Some(Line { label, text: text? })).collect()
}

/// The answer alone: the cause and the reduction on held-out data.
#[must_use]
pub fn verdict(d: &Diagnosis) -> [Line; 2] {
    [Line { label: Label::Cause, text: cause(d) }, Line { label: Label::Shrink, text: shrink(d) }]
}

/// The caveats, a line each.
#[must_use]
pub fn caveat_lines(found: &Diagnosed) -> Vec<Line> {
    caveats(found).map(|text| Line { label: Label::Caveat, text: format!("{text}.") }).collect()
}

/// The lines of the summary as text.
#[must_use]
pub fn summary(found: &Diagnosed) -> String {
    lines(found).iter().map(Line::to_string).collect::<Vec<_>>().join("\n")
}

impl std::fmt::Display for Line {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.label.word(), self.text)
    }
}

/// A share in percent, with two digits below 10 %.
pub(super) fn percent(share: f64) -> String {
    let value = 100.0 * share;
    match value.abs() {
        v if v >= 9.95 || v == 0.0 => format!("{value:.0} %"),
        v if v >= 0.995 => format!("{value:.1} %"),
        v if v >= 0.005 => format!("{value:.2} %"),
        _ => "0 %".to_owned(),
    }
}

/// How sure, in percent: a probability is never 0 or 100 %.
pub(super) fn sure(probability: f64) -> String {
    match 100.0 * probability {
        p if p < 1.0 => "below 1 %".to_owned(),
        p if p > 99.0 => "over 99 %".to_owned(),
        p => format!("{p:.0} %"),
    }
}

fn size(d: &Diagnosis) -> String {
    let mode = d.prediction.words();
    match (d.gap.before, d.gap.floor) {
        (Some(before), Some(floor)) => format!(
            "{}, {mode} ({}), misses the training logs by {} of their standard deviation; noise is {}.",
            shown(&d.model),
            d.prediction.why,
            percent(before),
            percent(floor)
        ),
        _ => format!(
            "every output of {} stands still in the logs, so there is nothing to compare.",
            shown(&d.model)
        ),
    }
}

fn place(d: &Diagnosis) -> String {
    let Some(Place { output, time, band, regime }) = Place::of(d) else {
        return "nothing stands out above the noise.".to_owned();
    };
    let mut text = format!("{} of it in `{}`", percent(output.share), shown(&output.name));
    if let Some(t) = time {
        text += &format!(", mostly {:.2} to {:.2} s of {}", t.from_s, t.to_s, shown(base(&t.log)));
    }
    if let Some(b) = band {
        text += &format!(", {}", frequencies(b.from_hz, b.to_hz));
    }
    if let Some(r) = regime {
        text += &format!(", where {} is {:.4} to {:.4}", shown(&r.variable), r.from, r.to);
    }
    text + "."
}

/// The base name of a file.
pub(super) fn base(name: &str) -> &str {
    std::path::Path::new(name).file_name().and_then(|n| n.to_str()).unwrap_or(name)
}

/// A band of frequencies; of slow plants as periods, the longest first.
fn frequencies(from_hz: f64, to_hz: f64) -> String {
    const SLOW_HZ: f64 = 0.01;
    if to_hz >= SLOW_HZ || from_hz <= 0.0 {
        return format!("{from_hz:.2} to {to_hz:.2} Hz");
    }
    let period = |hz: f64| {
        let seconds = 1.0 / hz;
        match seconds {
            s if s >= 2.0 * 86_400.0 => format!("{:.1} days", s / 86_400.0),
            s if s >= 2.0 * 3600.0 => format!("{:.1} h", s / 3600.0),
            s => format!("{:.1} min", s / 60.0),
        }
    };
    format!("periods of {} to {}", period(from_hz), period(to_hz))
}

/// `0.12993 s (0.12961 to 0.13022)`; of several parameters each with its name.
pub(super) fn values(parameters: &[FoundParameter]) -> String {
    let one = |p: &FoundParameter| {
        let name = if parameters.len() > 1 { format!("{} ", p.name) } else { String::new() };
        let Some(value) = p.value else { return format!("no {} limit", p.name) };
        match estimate(value, p.ci95) {
            (value, Some([lower, upper])) => {
                format!("{name}{value}{} ({lower} to {upper})", unit(&p.unit))
            }
            (value, None) => format!("{name}{value}{} (at a bound)", unit(&p.unit)),
        }
    };
    parameters.iter().map(one).collect::<Vec<_>>().join(", ")
}

/// An effect in words.
fn worded(effect: &FoundEffect) -> String {
    in_words(&effect.effect, &shown(&effect.channel))
}

/// A member of a class in words, from its code.
fn member(member: &Member) -> String {
    let one = |code: &String| match code.split_once(':') {
        Some((effect, channel)) => in_words(effect, &shown(channel)),
        None => shown(code),
    };
    match member {
        Member::One(code) => one(code),
        Member::Several(codes) => {
            format!("{} together", listed(&codes.iter().map(one).collect::<Vec<_>>()))
        }
    }
}

/// The other members of a class, in words.
pub(super) fn others(class: &CauseClass) -> Vec<String> {
    class.members.iter().skip(1).map(member).collect()
}

/// The other members of a class, as a list with a few names; `None` for a class of one.
pub(super) fn aliases(class: &CauseClass) -> Option<String> {
    let others = others(class);
    let more = others.len().saturating_sub(NAMED);
    let mut names: Vec<String> = others.iter().take(NAMED).cloned().collect();
    names.extend((more > 0).then(|| format!("{more} more")));
    (!names.is_empty()).then(|| listed(&names))
}

/// The part of the gap that the contributions and the recalibration explain together.
fn explained(d: &Diagnosis) -> Option<f64> {
    Some(1.0 - d.cause.remainder.as_ref()?.share.learnt?)
}

fn cause(d: &Diagnosis) -> String {
    let confirmed = match Shrink::of(d) {
        Shrink::NotConfirmed { .. } => " Held-out data do not confirm it.",
        _ => "",
    };
    on_training_logs(d) + &further(d) + confirmed
}

/// The unexplained part where effects are named and more than noise remains.
fn further(d: &Diagnosis) -> String {
    let incomplete = matches!(d.cause.explained, Some(Explained::Mostly | Explained::Part));
    match (Cause::of(d), explained(d)) {
        (Cause::Effects(_), Some(share)) if incomplete => {
            format!(" More acts: {} of the gap stays unexplained.", percent(1.0 - share))
        }
        _ => String::new(),
    }
}

/// The cause as the training logs show it.
fn on_training_logs(d: &Diagnosis) -> String {
    let names =
        || listed(&d.cause.classes.iter().map(|class| class.name.clone()).collect::<Vec<_>>());
    match Cause::of(d) {
        Cause::NothingMoves => "none could be looked for, because no output moves.".to_owned(),
        Cause::None => format!(
            "none; no effect of the catalogue explains more than noise; {} sure.",
            sure(probability(d))
        ),
        Cause::Mostly => {
            let stays = explained(d).map(|e| percent(1.0 - e)).unwrap_or_default();
            format!("mostly {}; {stays} of the gap stays unexplained.", names())
        }
        Cause::Part => {
            let stays = explained(d).map(|e| percent(1.0 - e)).unwrap_or_default();
            format!(
                "unknown for the most part; {} explain some of the gap, {stays} of it stays unexplained.",
                names()
            )
        }
        Cause::Unknown => match d.cause.remainder.as_ref().and_then(|r| r.unrelated) {
            Some(unrelated) if unrelated.holds() => format!(
                "no command; the residual is unrelated to the commands and to the model's outputs, as under gusts or slow heat; {} sure.",
                sure(probability(d))
            ),
            _ => format!(
                "unknown; more than noise stays that no effect of the catalogue explains; {} sure.",
                sure(probability(d))
            ),
        },
        Cause::Effects([one]) => single(d, one),
        Cause::Effects(several) => several_causes(d, several),
    }
}

/// The classes that explain something; effects of a smaller share are counted.
fn several_causes(d: &Diagnosis, several: &[FoundEffect]) -> String {
    let own = |e: &FoundEffect, c: &CauseClass| {
        c.representative == format!("{}:{}", e.effect, e.channel)
            || matches!(c.members.first(), Some(Member::Several(codes))
                if codes.contains(&format!("{}:{}", e.effect, e.channel)))
    };
    let below = several.iter().filter(|e| !d.cause.classes.iter().any(|c| own(e, c))).count();
    let text = match d.cause.classes.as_slice() {
        [] => return together(d, &several.iter().map(worded).collect::<Vec<_>>()),
        [_] => match several.iter().find(|e| d.cause.classes.iter().any(|c| own(e, c))) {
            Some(one) if several.len() == below + 1 => single(d, one),
            _ => together(d, &d.cause.classes.iter().map(|c| c.name.clone()).collect::<Vec<_>>()),
        },
        classes => together(d, &classes.iter().map(|c| c.name.clone()).collect::<Vec<_>>()),
    };
    let text = text + &events(several);
    match below {
        0 => text,
        1 => format!("{text} One more effect explains less than 1 %."),
        more => format!("{text} {more} more effects explain less than 1 % each."),
    }
}

/// The changes at one time, a sentence per event.
fn events(effects: &[FoundEffect]) -> String {
    let changes = effects.iter().filter_map(|e| match e.parameters.as_slice() {
        [before, time, later] if time.name == "time" => Some((e, before, time, later)),
        _ => None,
    });
    let changes: Vec<_> = changes.collect();
    let mut times: Vec<&FoundParameter> = Vec::new();
    for (_, _, time, _) in &changes {
        if times.iter().all(|known| known.value != time.value) {
            times.push(time);
        }
    }
    let one = |(e, before, _, later): &(&FoundEffect, &FoundParameter, _, &FoundParameter)| {
        let number = |p: &FoundParameter| p.value.map(|v| estimate(v, p.ci95).0);
        let ends = number(before).zip(number(later));
        let (from, to) = ends.unwrap_or_default();
        let what = match e.effect.as_str() {
            "parameter_jump" => format!("`{}`", shown(&e.channel)),
            _ => worded(e),
        };
        format!("{what} from {from} to {to}{}", unit(&later.unit))
    };
    let event = |time: &FoundParameter| {
        let own: Vec<String> =
            changes.iter().filter(|(_, _, t, _)| t.value == time.value).map(one).collect();
        let at = values(std::slice::from_ref(time));
        (own.len() > 1).then(|| format!(" Something changes at {at}: {}.", listed(&own)))
    };
    times.into_iter().filter_map(event).collect()
}

fn together(d: &Diagnosis, names: &[String]) -> String {
    let share = explained(d).map(|e| format!(" Together they explain {} of the gap.", percent(e)));
    format!("{}.{}", listed(names), share.filter(|_| names.len() > 1).unwrap_or_default())
}

/// One effect that explains all.
fn single(d: &Diagnosis, effect: &FoundEffect) -> String {
    let class = d
        .cause
        .classes
        .iter()
        .find(|class| class.representative == format!("{}:{}", effect.effect, effect.channel));
    let likely = class.map(|class| {
        let most = if class.probability < 0.5 { "most likely of several, " } else { "" };
        format!("; {most}{} sure", sure(class.probability))
    });
    let share = explained(d).map(|e| format!(" It explains {} of the gap.", percent(e)));
    let alike =
        class.and_then(aliases).map(|others| format!(" These logs cannot tell it from {others}."));
    format!(
        "{}, {}{}.{}{}",
        worded(effect),
        values(&effect.parameters),
        likely.unwrap_or_default(),
        share.unwrap_or_default(),
        alike.unwrap_or_default()
    )
}

/// The parameters that `identify --structure` fits in the place of this diagnosis; `None` where something else acts, too.
#[must_use]
pub fn parameters_to_fit(d: &Diagnosis) -> Option<Vec<String>> {
    let Cause::Effects(effects) = Cause::of(d) else { return None };
    let name = |e: &FoundEffect| {
        // An entry of a matrix is named as the equations of a linear model name it.
        let entry = e.channel.replace(['[', ','], "_").replace(']', "");
        (e.effect == "parameter_error").then_some(entry)
    };
    effects.iter().map(name).collect()
}

/// The residual, in multiples of the noise; `None` where nothing was found to act.
fn left(d: &Diagnosis) -> Option<String> {
    let times = d.cause.remainder.as_ref().and_then(|r| r.above_floor);
    let rest = described(d).map(|sentence| format!(" It looks like {sentence}."));
    let stays = match times.filter(|_| acts(d)) {
        Some(times) if times > NOISE => {
            Some(format!("{times:.1} times the noise: something else differs, too."))
        }
        Some(_) => Some("noise.".to_owned()),
        None => rest.is_some().then(|| "the whole gap.".to_owned()),
    };
    Some(stays? + &rest.unwrap_or_default())
}

fn shrink(d: &Diagnosis) -> String {
    match Shrink::of(d) {
        Shrink::Falls { before, after, floor, fraction } => {
            let decoded = d.shrink.decoded.map(percent);
            let decoded = decoded.map(|p| format!("; once the lost commands are known, to {p}"));
            let interval = d.shrink.ci95.map(|ends| ends.map(percent));
            let interval = interval.map(|[l, u]| format!(", {l} to {u}"));
            let [before, after, fraction, floor] = [before, after, fraction, floor].map(percent);
            let ahead = by_horizon(d).map(|text| format!(" By horizon: {text}"));
            format!(
                "on held-out data the error falls from {before} to {after} (by {fraction}{}){}; noise is {floor}.{}",
                interval.unwrap_or_default(),
                decoded.unwrap_or_default(),
                ahead.unwrap_or_default()
            )
        }
        Shrink::NothingAdded { before } => format!(
            "nothing was added to the model; its error on held-out data is {}.",
            percent(before)
        ),
        Shrink::NotConfirmed { before } => format!(
            "none; with these causes the error on held-out data is not below its {}, so the written model is as it came.",
            percent(before)
        ),
        Shrink::NothingMoves => "no held-out output moves, so nothing can be said.".to_owned(),
    }
}

/// The nuisances of every log, as `input_offset:u = 1.30 ± 0.21 V in a.csv, …`; `None` without nuisances.
fn nuisances(d: &Diagnosis) -> Option<String> {
    let one = |(at, n): (usize, &NuisanceEstimate)| {
        let same =
            |before: &NuisanceEstimate| before.effect == n.effect && before.channel == n.channel;
        let begins = at == 0 || !d.nuisances.get(at - 1).is_some_and(same);
        let name = if begins { format!("{}:{} = ", n.effect, n.channel) } else { String::new() };
        let apart = if at == 0 {
            ""
        } else if begins {
            "; "
        } else {
            ", "
        };
        format!("{apart}{name}{}{} in {}", plus_minus(n.value, n.std), unit(&n.unit), n.log)
    };
    (!d.nuisances.is_empty()).then(|| d.nuisances.iter().enumerate().map(one).collect())
}

/// How the error grows ahead, before and after; `None` where predictions have no horizon.
fn by_horizon(d: &Diagnosis) -> Option<String> {
    let one = |h: &HorizonError| {
        Some(format!(
            "{} sample{} ahead from {} to {}",
            h.samples,
            if h.samples == 1 { "" } else { "s" },
            percent(h.before?),
            percent(h.after?)
        ))
    };
    let all: Vec<String> = d.shrink.horizons.iter().filter_map(one).collect();
    (!all.is_empty()).then(|| format!("{}.", all.join(", ")))
}

/// The leading rows of the ranking.
#[must_use]
pub fn ranking(d: &Diagnosis, rows: usize) -> Table {
    let mut table = Table::new(&["effect", "channel", "probability", "nrmse alone"], &[0, 1]);
    for row in d.cause.ranking.iter().take(rows) {
        let row = Ranked::of(row);
        let [effect, channel] = row.cells();
        table.row(vec![
            effect,
            channel,
            format!("{:.4}", row.probability),
            row.after.map_or_else(|| "-".to_owned(), |v| format!("{v:.4}")),
        ]);
    }
    table
}
