//! The check on withheld effects: known answers get their hand-computed scores, and whatever was changed or lost is noticed.

use crate::support::blind::{
    Check, always_input_delay, always_none, label, labels, perfect, write,
};
use deadtime::blind::{BlindScore, Limit, SCORES, Score, Verdict, check, commitments, load, score};
use deadtime::diagnose::Diagnosis;
use serde_json::{Value, json};

/// Of a score against its hand computation.
const ROUNDING: f64 = 1e-12;

fn scores(check: &Check) -> BlindScore {
    score(&load(&check.verdicts(), &check.labels(), None).unwrap())
}

fn refused(check: &Check) -> String {
    load(&check.verdicts(), &check.labels(), Some(&check.cases())).unwrap_err().to_string()
}

#[track_caller]
fn assert_scores(all: &[Score], expected: &[(&str, f64, usize)]) {
    for (name, value, count) in expected {
        let score =
            all.iter().find(|s| s.name == *name).unwrap_or_else(|| panic!("no score {name}"));
        let got = score.value.unwrap_or_else(|| panic!("{name} has no value"));
        assert!(
            (got - value).abs() <= ROUNDING * value.abs().max(1.0) && score.count == *count,
            "{name}: {value} of {count}, got {score:?}"
        );
    }
}

#[test]
fn perfect_answer_scores_one() {
    let check = Check::new();
    check.answer(perfect);
    let scores = scores(&check);
    assert_scores(
        &scores.scores,
        &[
            ("right", 1.0, 8),
            ("top1", 1.0, 4),
            ("top3", 1.0, 4),
            ("top1_class", 1.0, 4),
            ("top3_class", 1.0, 4),
            ("missed", 0.0, 4),
            ("needless_unknown", 0.0, 4),
            ("extra_effects", 0.0, 4),
            ("class_size", 1.5, 4), // 1, 1, 2, 3
            ("false_alarm", 0.0, 2),
            ("unknown_recall", 1.0, 1),
            ("pair_exact", 1.0, 1),
            ("pair_class", 1.0, 1),
            ("parameter_error", 0.0, 4),
            ("parameter_missing", 0.0, 4),
            ("coverage", 1.0, 4),
            ("without_interval", 0.0, 4),
            ("where_output", 1.0, 1),
            ("where_time", 1.0, 1),
            ("where_band", 1.0, 1),
            ("of_oracle", 1.0, 1),
            ("harm", 0.0, 8),
            ("log_loss", 0.0, 8),
            ("time_median", 2.0, 8),
            ("time_max", 2.0, 8),
        ],
    );
    assert!(
        scores
            .confusion
            .iter()
            .all(|c| c.truth == c.verdict || (c.truth == "pair" && c.verdict == "input_delay"))
    );
    assert_eq!(scores.reliability[4].exact, Some(1.0));
}

#[test]
fn answering_input_delay_always_gets_its_poor_score() {
    let check = Check::new();
    check.answer(|_| always_input_delay());
    let scores = scores(&check);
    let log_loss = (-(0.9_f64.ln()) - 2.0 * 0.1_f64.ln() - 5.0 * 1e-6_f64.ln()) / 8.0;
    assert_scores(
        &scores.scores,
        &[
            ("right", 0.25, 8),             // s1, and s4 by its class
            ("top1", 0.25, 4),              // s1
            ("top3", 0.25, 4),              // the second answer is none
            ("top1_class", 0.5, 4),         // s1, s4
            ("top3_class", 0.5, 4),         //
            ("missed", 0.0, 4),             //
            ("named_class_size", 1.0, 4),   //
            ("named_class_holds", 0.25, 4), //
            ("false_alarm", 1.0, 2),        //
            ("unknown_recall", 0.0, 1),     //
            ("pair_exact", 0.0, 1),         //
            ("pair_class", 0.0, 1),         //
            ("pair_any", 1.0, 1),           //
            ("parameter_error", 0.2, 1),    // |0.06 − 0.05|/0.05
            ("deviation_error", 0.2, 1),    //
            ("coverage", 0.0, 1),           // 0.05 is not in [0.055, 0.065]
            ("where_output", 1.0, 1),       //
            ("where_time", 1.0 / 3.0, 1),   // [2, 4] with [3, 5]
            ("where_band", 0.2, 1),         // [1, 3] with [2, 6]
            ("of_oracle", 0.375, 1),        // (1 − 0.8²)/(1 − 0.2²)
            ("harm", 0.0, 8),               //
            ("log_loss", log_loss, 8),
        ],
    );
    // Wilson's interval of 1 of 4, from its equation in another language.
    let [low, high] = scores.get("top1").unwrap().ci95.unwrap();
    assert!(
        (low - 0.045_587_260_809_700_58).abs() < ROUNDING
            && (high - 0.699_358_157_417_598_1).abs() < ROUNDING,
        "{low} {high}"
    );
    assert_eq!((scores.reliability[4].cases, scores.reliability[4].exact), (8, Some(0.125)));
}

#[test]
fn answering_none_always_gets_its_poor_score() {
    let check = Check::new();
    check.answer(|_| always_none());
    let scores = scores(&check);
    assert_scores(
        &scores.scores,
        &[
            ("right", 0.25, 8), // n1, n2
            ("top1", 0.0, 4),
            ("top3", 0.25, 4),      // input_delay is its second answer: s1
            ("top3_class", 0.5, 4), // and s4
            ("top1_class", 0.0, 4),
            ("missed", 1.0, 4),
            ("false_alarm", 0.0, 2),
            ("unknown_recall", 0.0, 1),
            ("pair_any", 0.0, 1),
            ("where_time", 0.0, 1),
            ("harm", 1.0, 8), // 0.52 after 0.5
        ],
    );
    assert_eq!(
        scores.get("parameter_error").unwrap(),
        &Score { name: "parameter_error", value: None, ci95: None, count: 0 }
    );
}

/// A contribution with a share, and what could stand in its place.
fn contribution(effect: &str, channel: &str, share: f64, class: &[&str]) -> Value {
    json!({ "effect": effect, "channel": channel, "parameters": [], "strength": "clear", "share": { "learnt": share, "held_out": share },
            "without_it": 0.3, "class": class, "surrogate": false })
}

#[test]
fn what_contributes_is_judged_by_share_up_to_what_the_data_or_the_diagnosis_cannot_tell_apart() {
    let truth = |alias_class: Value| {
        let effect = |name: &str, channel: &str| json!({ "effect": name, "channel": channel, "parameters": {} });
        let effects =
            json!([effect("input_gain", "u"), effect("deadband", "u"), effect("backlash", "u")]);
        label(
            "m1",
            "mixture",
            effects,
            json!({ "shares": [0.6, 0.3, 0.1], "alias_class": alias_class, "before": 1.0, "oracle_after": 0.2 }),
        )
    };
    let mut answer = serde_json::to_value(always_none()).unwrap();
    answer["format"] = json!("deadtime/diagnosis@2");
    answer["cause"]["contributions"] = json!([
        contribution("sensor_gain", "*", 0.5, &[]),
        contribution("stribeck_friction", "v", 0.25, &["deadband:u"]),
        contribution("saturation", "u", 0.2, &[]),
    ]);
    let answer: Diagnosis = serde_json::from_value(answer).unwrap();
    let judged = |alias_class: Value| {
        let check = Check::new();
        check.answer(perfect);
        let truth = truth(alias_class);
        check.add(&truth);
        check.answer_one(&truth, &answer);
        scores(&check).scores
    };
    // A gain at the sensor is a gain at the input, as the label says; friction may be a dead band, as the diagnosis says.
    let expected = [
        ("strongest", 1.0, 1),
        ("recall", 0.9, 1),
        ("precision", 0.75 / 0.95, 1),
        ("share_error", 0.075, 2),
    ];
    assert_scores(
        &judged(json!([["input_gain:u", "sensor_gain:y"], ["deadband:u"], ["backlash:u"]])),
        &expected,
    );
    // Where the label says that data tell them apart, or says nothing, the gain is missed and a false one is named.
    let expected = [
        ("strongest", 0.0, 1),
        ("recall", 0.3, 1),
        ("precision", 0.25 / 0.95, 1),
        ("share_error", 0.05, 1),
    ];
    for apart in [json!([["input_gain:u"], ["deadband:u"], ["backlash:u"]]), json!([])] {
        assert_scores(&judged(apart), &expected);
    }
}

/// Of four wrong numbers one is too small to count; one of the others is a contribution, one stands in the block beside one that is right.
#[test]
fn a_set_of_wrong_numbers_is_judged_as_a_set() {
    let number = |channel: &str| json!({ "effect": "parameter_error", "channel": channel, "parameters": {} });
    let effects = json!([number("mass"), number("spring"), number("damping"), number("length")]);
    let alias_class = json!([
        ["parameter_error:mass"],
        ["parameter_error:spring"],
        ["parameter_error:damping"],
        ["parameter_error:length"]
    ]);
    let truth = label(
        "m2",
        "mixture",
        effects,
        json!({ "shares": [0.5, 0.3, 0.195, 0.005], "alias_class": alias_class }),
    );
    let mut answer = serde_json::to_value(always_none()).unwrap();
    answer["format"] = json!("deadtime/diagnosis@2");
    answer["cause"]["contributions"] = json!([contribution("parameter_error", "mass", 0.5, &[])]);
    let in_block = |name: &str| json!({ "name": name, "unit": "1", "value": 1.0, "std": 0.1, "ci95": [0.8, 1.2] });
    answer["cause"]["recalibration"] = json!({
        "accepted": true, "size": 0.1, "share": { "learnt": 0.4, "held_out": 0.4 },
        "parameters": [in_block("spring"), in_block("gravity")], "directions": [],
    });
    let answer: Diagnosis = serde_json::from_value(answer).unwrap();
    let check = Check::new();
    check.answer(perfect);
    check.add(&truth);
    check.answer_one(&truth, &answer);
    // Two of three, and one that is right as it is.
    assert_scores(&scores(&check).scores, &[("numbers", 4.0 / 6.0, 1)]);
}

#[test]
fn unknown_is_a_false_alarm_on_none_and_needless_on_an_effect() {
    let check = Check::new();
    check.answer(|_| {
        let mut answer = always_none();
        answer.cause.verdict = "unknown".into();
        answer
    });
    assert_scores(
        &scores(&check).scores,
        &[
            ("false_alarm", 1.0, 2),
            ("needless_unknown", 1.0, 4),
            ("missed", 0.0, 4),
            ("unknown_recall", 1.0, 1),
        ],
    );
}

#[test]
fn pair_counts_up_to_the_alias_class_of_each_effect() {
    let check = Check::new();
    let with = |effects: [(&'static str, &'static str); 2]| {
        move |label: &serde_json::Value| {
            let mut answer = perfect(label);
            if label["id"] == "p1" {
                for (found, (effect, channel)) in answer.cause.effects.iter_mut().zip(effects) {
                    (found.effect, found.channel) = (effect.into(), channel.into());
                }
                (answer.cause.verdict, answer.cause.channel) =
                    (effects[0].0.into(), Some(effects[0].1.into()));
            }
            answer
        }
    };
    check.answer(with([("input_gain", "u"), ("output_delay", "y")]));
    assert_scores(
        &scores(&check).scores,
        &[("pair_exact", 0.0, 1), ("pair_class", 1.0, 1), ("pair_any", 0.0, 1), ("right", 1.0, 8)],
    );
    // Two names of one and the same effect are no pair.
    check.answer(with([("input_delay", "u"), ("output_delay", "y")]));
    assert_scores(
        &scores(&check).scores,
        &[
            ("pair_exact", 0.0, 1),
            ("pair_class", 0.0, 1),
            ("pair_any", 1.0, 1),
            ("right", 0.875, 8),
        ],
    );
}

#[test]
fn all_outputs_and_one_output_differ_when_there_are_several() {
    let check = Check::new();
    check.answer(|label| {
        let mut answer = perfect(label);
        if label["id"] == "s4" {
            answer.cause.channel = Some("*".into());
            answer.cause.effects[0].channel = "*".into();
        }
        answer
    });
    assert_scores(&scores(&check).scores, &[("top1", 1.0, 4)]);
    let path = check.verdicts().join("s4/diagnosis.json");
    let mut two = Diagnosis::read(&path).unwrap();
    let mut other = two.gap.outputs[0].clone();
    other.name = "z".into();
    two.gap.outputs.push(other);
    two.write(&path).unwrap();
    assert_scores(&scores(&check).scores, &[("top1", 0.75, 4), ("top1_class", 1.0, 4)]);
}

#[test]
fn parameters_are_compared_as_what_they_are() {
    let check = Check::new();
    check.answer(perfect);
    let effect = |name: &str, channel: &str, parameters: Value| json!([{ "effect": name, "channel": channel, "parameters": parameters }]);
    let estimate = |name: &str, unit: &str, value: Value, ci95: Value| json!({ "name": name, "unit": unit, "value": value, "std": null, "ci95": ci95 });
    let answer_with = |id: &str, effects: Value, estimates: Value| {
        let label = label(id, "single", effects.clone(), json!({}));
        check.add(&label);
        let mut answer = serde_json::to_value(always_none()).unwrap();
        (answer["cause"]["verdict"], answer["cause"]["channel"]) =
            (effects[0]["effect"].clone(), effects[0]["channel"].clone());
        answer["cause"]["effects"] = json!([{ "effect": effects[0]["effect"], "channel": effects[0]["channel"], "parameters": estimates }]);
        check.answer_one(&label, &serde_json::from_value(answer).unwrap());
        let scores = scores(&check);
        scores.answers.into_iter().find(|a| a.id == id).unwrap().judgement
    };
    let near = |got: &[f64], expected: &[f64]| {
        assert!(
            got.len() == expected.len()
                && got.iter().zip(expected).all(|(g, e)| (g - e).abs() < 1e-9),
            "{got:?}, not {expected:?}"
        );
    };
    // Half of a skew is missed, though its ratio is right to half a per cent; at a bound there is no interval.
    let skew = answer_with(
        "x1",
        effect("clock_skew", "*", json!({ "ratio": 1.01 })),
        json!([estimate("ratio", "1", json!(1.005), json!(null))]),
    );
    near(&skew.parameter_errors, &[0.005 / 1.01]);
    near(&skew.deviation_errors, &[0.5]);
    assert_eq!((skew.covered.len(), skew.without_interval), (0, vec![true]));
    // A limit that does not act has no error; one that is 0 is measured by the other, of the same unit.
    let limits = json!([{ "name": "lower", "value": 0.0 }, { "name": "upper", "value": 2.0 }]);
    let saturation = answer_with(
        "x2",
        effect("saturation", "u", limits),
        json!([
            estimate("lower", "1", json!(0.001), json!([-0.1, 0.1])),
            estimate("upper", "1", json!(2.1), json!([2.05, 2.15]))
        ]),
    );
    near(&saturation.parameter_errors, &[0.5, 0.05]);
    assert_eq!((saturation.deviation_errors.len(), saturation.covered), (0, vec![true, false]));
    let unlimited = json!({ "lower": null, "upper": 2.0, "note": "no number" });
    let one_sided = answer_with(
        "x3",
        effect("saturation", "u", unlimited),
        json!([estimate("lower", "1", json!(null), json!(null))]),
    );
    assert_eq!(
        (one_sided.parameter_errors.len(), one_sided.parameter_missing, one_sided.without_interval),
        (0, vec![true], vec![true])
    );
    // 6.2 rad and 0 rad are 0.083 rad apart.
    let phase = answer_with(
        "x4",
        effect("periodic_disturbance", "v", json!({ "phase": 6.2 })),
        json!([estimate("phase", "rad", json!(0.0), json!([-0.1, 0.1]))]),
    );
    near(&phase.parameter_errors, &[(std::f64::consts::TAU - 6.2) / std::f64::consts::PI]);
    assert_eq!(phase.covered, [true]);
}

#[test]
fn parts_and_the_confusion_matrix_count_every_case_once() {
    let check = Check::new();
    check.answer(|_| always_input_delay());
    let scores = scores(&check);
    let part = |key: &str, value: &str| {
        scores
            .by
            .iter()
            .find(|b| b.key == key && b.value == value)
            .unwrap_or_else(|| panic!("{key} {value}"))
    };
    for key in ["effect", "plant"] {
        assert_eq!(
            scores.by.iter().filter(|b| b.key == key).map(|b| b.cases).sum::<usize>(),
            8,
            "{key}"
        );
    }
    assert_eq!(scores.confusion.iter().map(|c| c.cases).sum::<usize>(), 8);
    assert_eq!(
        (part("plant", "toy").cases, part("plant", "cart").cases, part("loop", "closed").cases),
        (6, 2, 1)
    );
    for (strength, top1) in [
        ("below 10 dB", 0.0),
        ("from 10 to 20 dB (weak)", 1.0),
        ("from 20 to 30 dB (medium)", 0.0),
        ("over 30 dB (strong)", 0.0),
    ] {
        assert_scores(&part("strength", strength).scores, &[("top1", top1, 1)]);
    }
    assert_scores(&part("effect", "input_delay").scores, &[("top1", 1.0, 1)]);
    assert_scores(
        &part("effect", "output_delay").scores,
        &[("top1", 0.0, 1), ("top1_class", 1.0, 1)],
    );
}

#[test]
fn intervals_hold_their_value_and_repeat() {
    let check = Check::new();
    check.answer(|label| if label["id"] == "s1" { always_input_delay() } else { perfect(label) });
    let first = scores(&check);
    assert_eq!(first, scores(&check));
    assert_eq!(first.scores.len(), SCORES.len());
    let mut with_interval = 0;
    for score in first.scores.iter().chain(first.by.iter().flat_map(|b| &b.scores)) {
        if let (Some(value), Some([low, high])) = (score.value, score.ci95) {
            with_interval += 1;
            assert!(
                low <= value + ROUNDING
                    && value <= high + ROUNDING
                    && low.is_finite()
                    && high.is_finite(),
                "{score:?}"
            );
        }
    }
    assert!(with_interval > SCORES.len(), "{with_interval} scores have an interval");
}

#[test]
fn limit_is_missed_only_when_the_whole_interval_lies_beyond_it() {
    let check = Check::new();
    check.answer(|_| always_input_delay());
    let scores = scores(&check);
    let judge = |text: &str| text.parse::<Limit>().unwrap().judge(&scores);
    // 1 of 4: from 0.0456 to 0.6994.
    assert_eq!(judge("top1>=0.69"), Verdict::Kept);
    assert_eq!(judge("top1>=0.71"), Verdict::Missed);
    assert_eq!(judge("top1<=0.05"), Verdict::Kept);
    assert_eq!(judge("top1<=0.04"), Verdict::Missed);
    assert_eq!(judge("time_max<=1.9"), Verdict::Missed);
    check.answer(|_| always_none());
    assert_eq!(
        "coverage>=0.5".parse::<Limit>().unwrap().judge(&self::scores(&check)),
        Verdict::NotMeasured
    );
    for wrong in ["top1=0.9", "top1>=much", "top1>=NaN", "topping>=1"] {
        assert!(wrong.parse::<Limit>().is_err(), "{wrong}");
    }
}

#[test]
fn commitment_is_the_hash_of_salt_and_label_by_either_reading() {
    // sha256sum of `xyz{"id": "a", "salt": "", "n": 1}` and of `xyz{"id": "a", "n": 1}`, each with a line end.
    let label = b"{\"id\": \"a\", \"salt\": \"xyz\", \"n\": 1}\n";
    let expected = [
        "955ce6b14dcaf32b22f832c12684876cc52ea39923c8180ae907d968d9cf88b1",
        "daf4fef067deae774a3678dfba0bca0660c3e03b1bee1a2b7364858f9d62682b",
    ];
    assert_eq!(commitments(label, "xyz").unwrap(), expected);
    for hash in expected {
        assert_eq!(check(&hash.to_uppercase(), label, "xyz"), Some(true));
        assert_eq!(check(hash, label, "xyy"), Some(false));
        assert_eq!(check(hash, &label[..label.len() - 1], "xyz"), Some(false));
    }
    assert_eq!(check(expected[0], b"{\"id\": \"a\"}", "xyz"), None);
}

#[test]
fn changed_label_and_changed_salt_are_caught_by_name() {
    for (from, to) in
        [("0.2", "0.3"), ("salt of s2", "salt of s3"), ("sensor_bias", "sensor_gain"), ("}\n", "}")]
    {
        let check = Check::new();
        check.answer(perfect);
        let path = check.labels().join("s2.json");
        let text = std::fs::read_to_string(&path).unwrap();
        let (head, tail) = text.rsplit_once(from).unwrap();
        write(&path, &format!("{head}{to}{tail}"));
        let error = refused(&check);
        assert!(error.contains("case s2:") && error.contains("does not match"), "{to}: {error}");
    }
}

#[test]
fn commitments_that_are_missing_garbled_or_unequal_are_errors() {
    let check = Check::new();
    check.answer(perfect);
    let copy = check.verdicts().join("s3/commitment.txt");
    let committed = std::fs::read_to_string(&copy).unwrap();
    write(&copy, &"0".repeat(64));
    assert!(refused(&check).contains("case s3: the commitment of the verdict differs"));
    write(&copy, "soon\n");
    assert!(refused(&check).contains("holds `soon`"));
    std::fs::remove_file(&copy).unwrap();
    assert!(
        load(&check.verdicts(), &check.labels(), Some(&check.cases())).is_ok(),
        "the case's own commitment is enough"
    );
    std::fs::remove_file(check.cases().join("s3/commitment.txt")).unwrap();
    let error = refused(&check);
    assert!(error.contains("no commitment.txt for case s3"), "{error}");
    write(&copy, &format!("{}  s3.json\n", committed.trim().to_uppercase()));
    assert!(load(&check.verdicts(), &check.labels(), None).is_ok());
}

#[test]
fn labels_without_verdict_and_verdicts_without_label_are_named() {
    let check = Check::new();
    check.answer(perfect);
    std::fs::remove_file(check.verdicts().join("s1/diagnosis.json")).unwrap();
    std::fs::remove_file(check.labels().join("n2.json")).unwrap();
    let error = refused(&check);
    assert!(error.contains("labels [s1]") && error.contains("verdicts [n2]"), "{error}");

    let check = Check::new();
    check.answer(perfect);
    std::fs::remove_dir_all(check.cases().join("k1")).unwrap();
    assert!(refused(&check).contains("labels [k1]"));
}

#[test]
fn labels_that_contradict_themselves_are_refused() {
    let check = Check::new();
    check.answer(perfect);
    let mut label = labels()[4].clone();
    label["id"] = json!("s9");
    write(&check.labels().join("s1.json"), &label.to_string());
    assert!(refused(&check).contains("its id is `s9`"));
    label["id"] = json!("s1");
    label["group"] = json!("pair");
    write(&check.labels().join("s1.json"), &label.to_string());
    assert!(refused(&check).contains("group pair needs 2 effects, it has 1"));
    label["group"] = json!("single");
    label["effects"][0]["channel"] = json!(null);
    write(&check.labels().join("s1.json"), &label.to_string());
    assert!(refused(&check).contains("without name or channel"));
    write(&check.labels().join("s1.json"), "{}");
    assert!(refused(&check).contains("not a label"));
}

#[test]
fn folder_without_labels_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    assert!(
        load(folder.path(), folder.path(), None)
            .unwrap_err()
            .to_string()
            .contains("no label in it")
    );
}

#[test]
fn every_score_is_defined_in_the_documentation() {
    let page = include_str!("../../docs/blind.md");
    for definition in SCORES {
        let name = definition.name.strip_suffix("_q90").unwrap_or(definition.name);
        assert!(page.contains(&format!("`{name}`")), "{name}");
    }
}

#[test]
fn delays_that_move_have_scores_of_their_own() {
    let check = Check::new();
    check.answer(perfect);
    let moving = |id: &str| {
        let jump =
            json!([{ "effect": "delay_jump", "channel": "u", "parameters": { "delay": 0.1 } }]);
        label(
            id,
            "moving",
            jump,
            json!({ "alias_class": ["delay_jump:u", "input_delay:u"], "verdict": "delay_jump" }),
        )
    };
    // Named, taken for its alias and a little worse than nominal, taken for lost commands.
    let mut worse = serde_json::to_value(always_input_delay()).unwrap();
    worse["shrink"]["after"] = json!(0.501);
    let mut lost = serde_json::to_value(always_none()).unwrap();
    lost["cause"]["ranking"] = json!([{ "effect": "dropped_commands", "channel": "u", "probability": 0.6, "after": 0.4 },
        { "effect": "delay_jump", "channel": "u", "probability": 0.4, "after": 0.4 }]);
    lost["shrink"]["after"] = json!(0.5);
    let answers = [
        perfect(&moving("m1")),
        serde_json::from_value(worse).unwrap(),
        serde_json::from_value(lost).unwrap(),
    ];
    for (id, answer) in ["m1", "m2", "m3"].into_iter().zip(&answers) {
        check.add(&moving(id));
        check.answer_one(&moving(id), answer);
    }
    let scores = scores(&check);
    let third = 1.0 / 3.0;
    let own =
        [("moving_class", 2.0 * third, 3), ("moving_lost", third, 3), ("moving_worse", third, 3)];
    assert_scores(&scores.scores, &own);
    // Singles are counted apart, and `right` holds both.
    assert_scores(&scores.scores, &[("top1", 1.0, 4), ("right", 10.0 / 11.0, 11)]);
    assert_eq!((scores.groups["moving"], scores.groups["single"]), (3, 4));
}
