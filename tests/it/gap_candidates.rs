//! Terms that a user suspects: `[[candidates]]` of a model file, and `state += expression`.

use deadtime::diagnose::Diagnosis;
use deadtime::model::{CandidateEntry, ModelDocument};

use super::gap_hard::{diagnosed, document, log};

const BODIES: &str = r#"
format = "deadtime/model@1"
name = "two bodies"
kind = "lti"
inputs = [{ name = "u", unit = "V" }]
outputs = [{ name = "angle", unit = "rad" }, { name = "rate", unit = "rad/s" }]
states = [{ name = "a", unit = "K" }, { name = "b", unit = "K" }]
initial = [0.0, 0.0]
initial_std = [0.02, 0.02]
A = [[-0.5, 0.1], [0.2, -0.8]]
B = [[1.0], [0.0]]
C = [[1.0, 0.0], [0.0, 1.0]]
D = [[0.0], [0.0]]
"#;

fn suspecting(terms: &[&str]) -> ModelDocument {
    let mut model = document(BODIES);
    for term in terms {
        model.suspect(CandidateEntry::from_text(term).unwrap()).unwrap();
    }
    model
}

/// What is found where the machine has `acting` and the model suspects `terms`.
fn found(terms: &[&str], acting: &[(&str, &str, &[f64])]) -> Diagnosis {
    let machine = suspecting(terms);
    let logged = |i: u64| log(&machine, acting, 1500, 190 + i, &[0.0, 0.0]);
    diagnosed(&machine, &[logged(0), logged(1)], &[logged(2)])
}

#[test]
fn a_suspected_term_is_found_with_its_numbers_and_one_that_does_not_act_is_not_named() {
    let (bent, idle) = ("b += k*a*abs(a) - m*b*b*b", "a += h*sin(3*b)");
    let d = found(&[bent, idle], &[("candidate", bent, &[0.4, 0.9])]);
    assert_eq!(
        (d.cause.verdict.as_str(), d.cause.channel.as_deref()),
        ("candidate", Some(bent)),
        "{:?}",
        d.cause.effects
    );
    assert_eq!(d.cause.effects.len(), 1, "{:?}", d.cause.effects);
    for (parameter, truth) in d.cause.effects[0].parameters.iter().zip([("k", 0.4), ("m", 0.9)]) {
        let [lower, upper] = parameter.ci95.unwrap();
        assert!(
            parameter.name == truth.0
                && lower <= truth.1
                && truth.1 <= upper
                && upper - lower < 0.2 * truth.1,
            "{parameter:?} {truth:?}"
        );
    }
    assert!(d.shrink.of_explainable.unwrap() > 0.98, "{:?}", d.shrink);
}

#[test]
#[ignore = "nightly: one more diagnosis"]
fn a_width_is_searched_from_its_value_and_within_its_range() {
    let term = "b += k*tanh(a/w); k in 0 to 5, w = 0.5 in 0.02 to 3";
    let name = "b += k*tanh(a/w)";
    let d = found(&[term], &[("candidate", name, &[0.8, 0.15])]);
    assert_eq!(
        (d.cause.verdict.as_str(), d.cause.channel.as_deref()),
        ("candidate", Some(name)),
        "{:?}",
        d.cause.effects
    );
    for (parameter, truth) in d.cause.effects[0].parameters.iter().zip([0.8, 0.15]) {
        assert!((parameter.value.unwrap() / truth - 1.0).abs() < 0.1, "{parameter:?} {truth}");
    }
}

#[test]
#[ignore = "nightly: two diagnoses"]
fn suspicion_alone_names_nothing_and_changes_no_number() {
    let terms = ["b += k*a*abs(a)", "a += h*sin(3*b)", "b += g*(a - b)"];
    let d = found(&terms, &[]);
    assert_eq!(
        (d.cause.verdict.as_str(), d.cause.contributions.len()),
        ("none", 0),
        "{:?}",
        d.cause.contributions
    );
    let machine = document(BODIES);
    let logged = |i: u64| log(&machine, &[], 1500, 190 + i, &[0.0, 0.0]);
    let plain = diagnosed(&machine, &[logged(0), logged(1)], &[logged(2)]);
    let (with, without) = (d.gap.before.unwrap(), plain.gap.before.unwrap());
    assert!((with - without).abs() < 1e-6, "{with} {without}");
}

#[test]
fn a_file_keeps_its_candidates_and_takes_them_as_effects() {
    let text = BODIES.to_owned()
        + "[[candidates]]\nname = \"bend\"\nstate = \"b\"\nadds = \"k*a^2\"\n[candidates.parameters.k]\nunit = \"1/(K s)\"\nlower = 0.0\n\
           [[effects]]\neffect = \"candidate\"\nchannel = \"bend\"\nparameters = { k = 0.3 }\n";
    let model = document(&text);
    let again =
        ModelDocument::from_toml(&model.to_toml().unwrap(), std::path::Path::new("again")).unwrap();
    assert_eq!(model, again);
    let acting: &[(&str, &str, &[f64])] = &[("candidate", "bend", &[0.3])];
    let system = deadtime::simulate::System::new(&model, |_| Ok(0.0)).unwrap();
    let own = deadtime::effect::Applied::from_entry(&system, &model.effects()[0]).unwrap();
    assert_eq!((own.key().as_str(), own.values.as_slice()), ("candidate:bend", acting[0].2));
    let values = |acting| {
        log(&model, acting, 400, 7, &[0.0, 0.0]).channel("rate").unwrap().samples().values.to_vec()
    };
    let (with, without): (Vec<f64>, Vec<f64>) = (values(acting), values(&[]));
    let far = with.iter().zip(&without).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(far > 0.01, "{far}");
}

#[test]
fn what_cannot_be_searched_for_is_refused_with_the_remedy() {
    for (term, says) in [
        ("b = k*a", "write it as `state += expression`"),
        ("c += k*a", "the model has no state `c`"),
        ("b += 3*a", "multiply it by a name that the model does not know"),
        ("b += a + k", "it is not nothing at k = 0"),
        ("b += k*a; k in 1 to 2", "the value must lie in a range"),
        ("b += k*a; k in 2", "after `;` write"),
        ("b += k*a; j in -1 to 2", "does not stand in its expression"),
        ("b += k*a; a in -1 to 2", "is a name of the model already"),
        ("b += k*(a", "parenthes"),
    ] {
        let refused = CandidateEntry::from_text(term)
            .and_then(|c| document(BODIES).suspect(c))
            .unwrap_err()
            .to_string();
        assert!(refused.contains(says), "{term}: {refused}");
    }
    let mut twice = suspecting(&["b += k*a"]);
    let refused =
        twice.suspect(CandidateEntry::from_text("a += k*b").unwrap()).unwrap_err().to_string();
    assert!(refused.contains("give each its own name"), "{refused}");
}
