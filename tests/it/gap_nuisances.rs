//! What is another in every log and no cause: trims, offsets of sensors and clocks that the model file declares as nuisances.

use std::sync::LazyLock;

use deadtime::diagnose::{
    Caveat, Constancy, Diagnosed, Diagnosis, GapOptions, NuisanceEstimate, diagnose,
};
use deadtime::log::{Channel, Log};
use deadtime::model::ModelDocument;

use super::gap_hard::{document, log, servo};
use crate::support::schema::accepts;

fn nuisance(effect: &str, channel: &str, std: f64) -> String {
    format!("[[nuisances]]\neffect = \"{effect}\"\nchannel = \"{channel}\"\nstd = {std}\n")
}

fn declared(entries: &[(&str, &str, f64)]) -> ModelDocument {
    let entries: String =
        entries.iter().map(|(effect, channel, std)| nuisance(effect, channel, *std)).collect();
    document(&(servo(", initial_std = 0.02", "") + &entries))
}

/// Logs of the servo, each with its own value of a constant beside a cause.
fn logs(
    constant: (&str, &str),
    values: &[f64],
    cause: Option<(&str, &str, &[f64])>,
    seed: u64,
) -> Vec<Log> {
    let one = |(i, value): (u64, &f64)| {
        let own = [*value];
        let mut acting: Vec<(&str, &str, &[f64])> = cause.into_iter().collect();
        acting.push((constant.0, constant.1, &own));
        log(&declared(&[]), &acting, 900, seed + i, &[0.01, -0.01])
    };
    (0..).zip(values).map(one).collect()
}

fn found(model: &ModelDocument, logs: &[Log], held: &[Log]) -> Diagnosed {
    diagnose(model, logs, held, &GapOptions::default(), &|_| ()).unwrap()
}

fn keys(d: &Diagnosis) -> Vec<String> {
    d.cause.contributions.iter().map(|c| format!("{}:{}", c.effect, c.channel)).collect()
}

/// Every log's value is the true one to three times `finest`, and no less is known of it.
fn recovered(told: &[NuisanceEstimate], truth: &[f64], finest: f64) {
    assert_eq!(told.len(), truth.len(), "{told:?}");
    for (n, truth) in told.iter().zip(truth) {
        assert!(
            (n.value - truth).abs() < 3.0 * finest && n.std < finest,
            "{truth} is told as {n:?}"
        );
    }
}

const TRIMS: [f64; 3] = [0.6, -0.4, 0.2];
const DELAY: (&str, &str, &[f64]) = ("input_delay", "u", &[0.1]);
/// A fifth of a sample.
const WITHIN_S: f64 = 0.004;

/// Trims that the model file declares, beside a delay.
pub(crate) static TRIMMED: LazyLock<Diagnosed> = LazyLock::new(|| {
    let all = logs(("input_offset", "u"), &TRIMS, Some(DELAY), 6100);
    found(&declared(&[("input_offset", "u", 0.5)]), &all[..2], &all[2..])
});

#[test]
fn trims_that_are_declared_hide_no_cause_and_are_told_log_by_log() {
    let with = &*TRIMMED;
    let d = &with.diagnosis;
    assert_eq!(keys(d), ["input_delay:u"], "{:?}", d.cause.contributions);
    assert!((d.cause.verdict.as_str(), d.cause.channel.as_deref()) == ("input_delay", Some("u")));
    let delay = &d.cause.effects[0].parameters[0];
    assert!((delay.value.unwrap() - 0.1).abs() < WITHIN_S, "{delay:?}");
    recovered(&d.nuisances, &TRIMS, 0.05);
    assert!(
        d.nuisances.iter().all(|n| n.unit == "V" && n.prior_std == 0.5 && n.parameter == "offset")
    );
    assert!(d.shrink.of_explainable.unwrap() > 0.95, "{:?}", d.shrink);
    assert!(
        d.cause
            .not_tried
            .iter()
            .any(|n| n.effect == "input_offset" && n.why.contains("a nuisance of the model file"))
    );
    assert!(
        !with.caveats.iter().any(|c| matches!(
            c,
            Caveat::NuisanceBeyondPrior { .. } | Caveat::NuisanceAlike { .. }
        )),
        "{:?}",
        with.caveats
    );
    // The file and its schema, and the model that is handed over.
    let value = serde_json::to_value(d).unwrap();
    accepts(&value);
    assert_eq!(&serde_json::from_value::<Diagnosis>(value).unwrap(), d);
    let model = with.model.as_ref().unwrap();
    assert_eq!((model.nuisances().len(), model.effects().len()), (1, 1));
    assert!(model.to_toml().unwrap().contains("[[nuisances]]"));
}

#[test]
#[ignore = "nightly: that the section is needed"]
fn trims_that_are_not_declared_spoil_the_answer() {
    let all = logs(("input_offset", "u"), &TRIMS, Some(DELAY), 6100);
    let plain = found(&declared(&[]), &all[..2], &all[2..]);
    let left = |d: &Diagnosis| d.cause.remainder.as_ref().unwrap().above_floor.unwrap();
    let [without, with] = [&plain, &*TRIMMED].map(|found| left(&found.diagnosis));
    assert!(without > 5.0 && with < 1.5, "{without} and {with} times the noise");
    assert!(plain.diagnosis.nuisances.is_empty());
}

fn clean(count: usize) {
    let all = [
        (("input_offset", "u"), TRIMS, 0.5),
        (("sensor_bias", "angle"), [0.1, -0.25, 0.3], 0.3),
        (("constant_disturbance", "v"), [2.0, -1.0, 0.5], 2.0),
        (("clock_offset", "*"), [0.03, -0.05, 0.06], 0.05),
    ];
    for &(constant, values, std) in &all[..count] {
        let all = logs(constant, &values, None, 6200);
        let d = found(&declared(&[(constant.0, constant.1, std)]), &all[..2], &all[2..]).diagnosis;
        assert_eq!(
            (d.cause.verdict.as_str(), keys(&d).len()),
            ("none", 0),
            "{constant:?}: {:?}",
            d.cause.contributions
        );
        recovered(&d.nuisances, &values, 0.3 * std);
        assert!(
            d.shrink.before.unwrap() < 1.5 * d.shrink.floor.unwrap(),
            "{constant:?}: {:?}",
            d.shrink
        );
    }
}

#[test]
fn clean_logs_with_declared_trims_have_no_cause() {
    clean(1);
}

#[test]
#[ignore = "nightly: the same of three more constants"]
fn clean_logs_with_declared_trims_have_no_cause_for_four_constants() {
    clean(4);
}

/// The log with an output changed from a time on.
fn changed(log: &Log, output: &str, from_s: f64) -> Log {
    let channel = |c: &Channel| {
        let by = |t: f64| if c.name() == output && t >= from_s { 0.4 } else { 0.0 };
        let samples = c.samples();
        Channel::new(
            c.name(),
            c.unit(),
            log.time_s()
                .iter()
                .enumerate()
                .map(|(k, t)| samples.get(k).unwrap() + by(*t))
                .collect(),
        )
    };
    Log::new(log.source(), log.time_s().to_vec(), log.channels().map(channel).collect()).unwrap()
}

#[test]
#[ignore = "nightly: one more diagnosis"]
fn of_a_held_out_log_the_first_part_tells_the_constants_and_the_rest_is_scored() {
    let all = logs(("input_offset", "u"), &TRIMS, Some(DELAY), 6300);
    let model = declared(&[("input_offset", "u", 0.5)]);
    let d = found(&model, &all[..2], &all[2..]).diagnosis;
    let (span, end) = (&d.holdout[0], all[2].time_s()[899]);
    assert!(span.from_s > 0.33 * end && span.from_s < 0.45 * end && span.to_s == end, "{span:?}");
    assert!(
        d.shrink.after.unwrap() < 1.5 * d.shrink.floor.unwrap() && d.shrink.fraction.unwrap() > 0.5,
        "{:?}",
        d.shrink
    );
    recovered(&d.nuisances, &TRIMS, 0.1);
    // Half as much is known of it as of the others: a third of the samples.
    assert!(d.nuisances[2].std > 1.2 * d.nuisances[0].std, "{:?}", d.nuisances);
    let spoilt = found(&model, &all[..2], &[changed(&all[2], "angle", span.from_s)]).diagnosis;
    assert!(spoilt.shrink.after > d.shrink.after, "{:?}", spoilt.shrink);
    // The same cause is found, to a rounding of its number: that is told in logs of training alone.
    assert_eq!(keys(&spoilt)[0], "input_delay:u");
    let same = found(&model, &all[..2], &[changed(&all[2], "angle", end - 0.05)]).diagnosis;
    assert_eq!((same.shrink.before != d.shrink.before, &same.nuisances), (true, &d.nuisances));
}

#[test]
fn without_nuisances_a_held_out_log_is_scored_as_a_whole() {
    let all = logs(("input_offset", "u"), &[0.0, 0.0], Some(DELAY), 6310);
    let d = found(&declared(&[]), &all[..1], &all[1..]).diagnosis;
    assert!(d.holdout[0].from_s < 0.15 * d.holdout[0].to_s && d.nuisances.is_empty());
    assert!(serde_json::to_value(&d).unwrap().get("nuisances").is_none());
}

#[test]
#[ignore = "nightly: one more diagnosis"]
fn an_estimate_that_its_prior_contradicts_and_one_that_is_alike_are_told() {
    let far = logs(("input_offset", "u"), &TRIMS, None, 6400);
    let beyond = found(&declared(&[("input_offset", "u", 0.05)]), &far[..2], &far[2..]);
    let first = |c: &Caveat| matches!(c, Caveat::NuisanceBeyondPrior { log, std, .. } if log == "log6400.csv" && std == "0.05");
    assert!(beyond.caveats.iter().any(first), "{:?}", beyond.caveats);
    // The prior is far too wide, and the cause is swallowed: it says so.
    let alike = logs(("input_offset", "u"), &[0.3; 3], None, 6410);
    let swallowed = found(&declared(&[("input_offset", "u", 10.0)]), &alike[..2], &alike[2..]);
    let alike = swallowed.caveats.iter().any(|c| matches!(c, Caveat::NuisanceAlike { .. }));
    assert!(alike, "{:?} {:?}", swallowed.caveats, swallowed.diagnosis.nuisances);
}

/// An integrator whose start is not known: an offset of its sensor is the same as another start.
#[test]
fn what_the_start_does_as_well_is_shared_and_told_to_be_uncertain() {
    let text = r#"
format = "deadtime/model@1"
name = "cart"
kind = "lti"
inputs = [{ name = "u", unit = "V" }]
states = [{ name = "x", unit = "rad" }, { name = "v", unit = "rad/s" }]
outputs = [{ name = "angle", unit = "rad" }, { name = "rate", unit = "rad/s" }]
initial_std = [0.5, 0.02]
A = [[0.0, 1.0], [0.0, -2.4]]
B = [[0.0], [9.0]]
C = [[1.0, 0.0], [0.0, 1.0]]
D = [[0.0], [0.0]]
"#;
    let plain = document(text);
    let model = document(&format!("{text}{}", nuisance("sensor_bias", "angle", 0.5)));
    let logs: Vec<Log> = [0.5, -0.3]
        .iter()
        .zip(6500..)
        .map(|(own, seed)| {
            log(&plain, &[("sensor_bias", "angle", &[*own])], 900, seed, &[0.0, 0.0])
        })
        .collect();
    let options = GapOptions {
        prediction: Some(deadtime::diagnose::Mode::Simulation),
        ..GapOptions::default()
    };
    let d = diagnose(&model, &logs, &[], &options, &|_| ()).unwrap().diagnosis;
    assert_eq!(d.cause.verdict, "none", "{:?}", d.cause.contributions);
    for (n, truth) in d.nuisances.iter().zip([0.5, -0.3]) {
        // Halves, as both priors are alike; and no more is known of it than that.
        assert!((n.value - 0.5 * truth).abs() < 0.1 && n.std > 0.3, "{n:?}");
    }
}

/// A stable linear plant about a point at which its first output is 30 rad, or the logs' mean.
fn about_a_point(operating: &str) -> ModelDocument {
    document(&format!(
        r#"
format = "deadtime/model@1"
name = "heated plant"
kind = "lti"
inputs = [{{ name = "u", unit = "V" }}]
outputs = [{{ name = "angle", unit = "rad", operating = {operating} }}, {{ name = "rate", unit = "rad/s" }}]
states = [{{ name = "a", unit = "rad" }}, {{ name = "b", unit = "rad/s" }}]
initial = [0.0, 0.0]
initial_std = [0.02, 0.02]
A = [[-0.8, 0.3], [0.0, -2.0]]
B = [[1.0], [1.5]]
C = [[1.0, 0.0], [0.0, 1.0]]
D = [[0.0], [0.0]]
"#
    ))
}

/// A mean holds what the commands did on average: a constant on that output is no cause, and what is one is found beside it.
#[test]
#[ignore = "nightly: one more diagnosis"]
fn the_level_of_an_output_whose_operating_point_is_the_mean_is_a_nuisance() {
    let (machine, model) = (about_a_point("30.0"), about_a_point("\"mean\""));
    let runs = |acting: &[(&str, &str, &[f64])], seed: u64| -> Vec<Log> {
        (0..3).map(|i| log(&machine, acting, 900, seed + i, &[0.01, -0.01])).collect()
    };
    let clean = runs(&[], 6900);
    let samples: Vec<f64> = clean[..2]
        .iter()
        .flat_map(|l| (0..l.len()).map(|k| l.output("angle").unwrap().get(k).unwrap()))
        .collect();
    let mean = samples.iter().sum::<f64>() / samples.len() as f64;
    let d = found(&model, &clean[..2], &clean[2..]).diagnosis;
    assert_eq!(
        (d.cause.verdict.as_str(), keys(&d).len()),
        ("none", 0),
        "{:?}",
        d.cause.contributions
    );
    recovered(&d.nuisances, &[30.0 - mean; 3], 0.02);
    assert!(
        (30.0 - mean).abs() > 10.0 * d.nuisances[0].std,
        "the test has a level to tell: {mean}"
    );
    let why = d
        .cause
        .not_tried
        .iter()
        .find(|n| n.why.contains("`angle` is the mean of the logs"))
        .unwrap();
    assert_eq!(why.effect, "sensor_bias");

    let late = runs(&[DELAY], 6950);
    let with = found(&model, &late[..2], &late[2..]);
    assert_eq!(
        keys(&with.diagnosis),
        ["input_delay:u"],
        "{:?}",
        with.diagnosis.cause.contributions
    );
    assert!(with.diagnosis.shrink.of_explainable.unwrap() > 0.95, "{:?}", with.diagnosis.shrink);
    assert!(
        !with.caveats.iter().any(|c| matches!(c, Caveat::NuisanceAlike { .. })),
        "{:?}",
        with.caveats
    );
    // On a channel of its own a constant is a cause as before.
    let off = runs(&[("sensor_bias", "rate", &[0.5])], 6970);
    assert_eq!(keys(&found(&model, &off[..2], &off[2..]).diagnosis), ["sensor_bias:rate"]);
}

#[test]
fn a_constant_that_was_found_says_how_it_is_declared_and_whether_it_is_a_trim() {
    for (values, differs) in [([0.5, 0.9, 0.7], true), ([0.6, 0.6, 0.6], false)] {
        let all = logs(("input_offset", "u"), &values, None, 6600);
        let d = found(&declared(&[]), &all[..2], &all[2..]);
        let constant = d
            .caveats
            .iter()
            .find(|c| matches!(c, Caveat::Constant { .. }))
            .unwrap_or_else(|| panic!("{:?}", keys(&d.diagnosis)));
        let Caveat::Constant { constancy, .. } = constant else { unreachable!() };
        assert_eq!(matches!(constancy, Constancy::Differs { .. }), differs, "{constant:?}");
    }
    // One log: nothing is said of others.
    let one = logs(("input_offset", "u"), &[0.6], None, 6610);
    let d = found(&declared(&[]), &one, &[]);
    assert!(
        d.caveats
            .iter()
            .any(|c| matches!(c, Caveat::Constant { constancy: Constancy::NotKnown, .. })),
        "{:?}",
        d.caveats
    );
}

#[cfg(feature = "cli")]
mod program {
    use super::{nuisance, servo};
    use crate::support::program::{Folder, deadtime, text};

    const LOG: &str = include_str!("../../examples/uav_flight.csv");

    /// `deadtime gap` on the example's flight with these entries at the end of the example's model.
    fn gap(entries: &str) -> crate::support::program::Run {
        let folder = Folder::new();
        let model = folder.write(
            "lateral.toml",
            &format!("{}\n{entries}", include_str!("../../examples/uav_lateral_stabilised.toml")),
        );
        let log = folder.write("flight.csv", LOG);
        deadtime(&["gap", "--model", text(&model), "--log", text(&log), "--isolability"])
    }

    #[test]
    fn entries_that_are_none_are_refused_with_a_remedy() {
        let r = |std: &str| {
            format!("[[nuisances]]\neffect = \"input_offset\"\nchannel = \"r\"\nstd = {std}\n")
        };
        for (entries, says) in [
            (
                nuisance("input_ofset", "r", 1.0),
                &["input_ofset:r", "there is no effect `input_ofset`", "take one of: input_offset"]
                    [..],
            ),
            (
                nuisance("saturation", "r", 1.0),
                &["saturation:r", "more than add a constant", "sensor_bias"],
            ),
            (
                nuisance("input_offset", "q", 1.0),
                &["input_offset:q", "its channels in this model are: r", "correct its `channel`"],
            ),
            (r("0.0"), &["input_offset:r", "its `std` is 0", "above 0"]),
            (r("-1.0"), &["its `std` is -1", "above 0"]),
            (r("inf"), &["its `std` is inf", "finite number"]),
            (r("nan"), &["its `std` is NaN"]),
            (r("1.0").repeat(2), &["input_offset:r", "stands there twice; leave one"]),
            ("[[nuisances]]\neffect = \"input_offset\"\nchannel = \"r\"\n".to_owned(), &["std"]),
        ] {
            let run = gap(&entries);
            run.refused(says);
            assert!(run.stderr.contains("lateral.toml"), "which file? {}", run.stderr);
        }
        gap(&r("0.5")).done();
    }

    #[test]
    fn an_effect_of_the_model_may_be_a_nuisance_too_and_other_commands_take_the_section() {
        let folder = Folder::new();
        let own = "[[effects]]\neffect = \"input_offset\"\nchannel = \"u\"\nparameters = { offset = 0.1 }\n";
        let write = |name: &str, entries: &str| {
            folder.write(name, &(servo(", initial_std = 0.02", "") + entries))
        };
        let with = write("with.toml", &format!("{own}{}", nuisance("input_offset", "u", 0.5)));
        let without = write("without.toml", own);
        let rows: Vec<String> = (0..400)
            .map(|k| format!("{},{},0,0", 0.02 * f64::from(k), f64::from(k / 40 % 3) - 1.0))
            .collect();
        let log = folder.write(
            "log.csv",
            &format!("time,u [V],angle [rad],rate [rad/s]\n{}\n", rows.join("\n")),
        );
        let simulated = |model: &std::path::Path, out: &str| {
            let out = folder.path(out);
            deadtime(&["simulate", text(model), text(&log), "--out", text(&out)]).done();
            std::fs::read_to_string(out).unwrap()
        };
        assert_eq!(simulated(&with, "a.csv"), simulated(&without, "b.csv"));
        deadtime(&["check", "--model", text(&with), "--log", text(&log)]).done();
        let out = folder.path("gap");
        deadtime(&[
            "gap",
            "--model",
            text(&with),
            "--log",
            text(&folder.path("b.csv")),
            "--out",
            text(&out),
        ])
        .done();
        let kept = std::fs::read_to_string(out.join("model_with_effects.toml")).unwrap();
        assert!(kept.contains("[[nuisances]]") && kept.contains("[[effects]]"), "{kept}");
    }
}
