//! The sentences of an answer. Diagnoses are those of other tests, which assert their fields.

use deadtime::diagnose::{Caveat, Explained};
use deadtime::report::diagnosis::summary;

use crate::{gap_coarse, gap_nominal, gap_nuisances, gap_rest};

#[test]
fn what_comes_first_is_the_first_sentence_and_names_the_remedy() {
    let said = summary(&gap_nominal::MOVED);
    assert!(
        said.starts_with("First: fix this first; the rest may be wrong: `angle` is ")
            && said.contains("operating = \"mean\""),
        "{said}"
    );
}

#[test]
fn a_cause_with_something_else_explains_most_and_says_what_stays() {
    let said = summary(&gap_coarse::HUMMING);
    assert!(
        said.starts_with("Cause: mostly input delay of `u`; ")
            && said.contains("Left: ")
            && said.contains("times the noise: something else differs, too."),
        "{said}"
    );
}

/// A named effect with an unexplained part, written into a diagnosis whose effect explains nearly all.
#[test]
fn a_named_cause_with_an_unexplained_part_says_that_more_acts() {
    let complete = &*gap_nuisances::TRIMMED;
    let mut found = complete.clone();
    let cause = &mut found.diagnosis.cause;
    assert_ne!(cause.verdict, "unknown");
    cause.explained = Some(Explained::Mostly);
    cause.remainder.as_mut().unwrap().share.learnt = Some(0.043);
    assert!(summary(&found).contains(" More acts: 4.3 % of the gap stays unexplained."));
    assert!(!summary(complete).contains("More acts"));
}

#[test]
fn nuisances_are_told_log_by_log_with_their_unit() {
    let said = summary(&gap_nuisances::TRIMMED);
    assert!(
        said.contains("Nuisances: input_offset:u = 0.") && said.contains(" V in log6101.csv, "),
        "{said}"
    );
}

#[test]
fn the_remainder_has_its_sentence() {
    let found = &*gap_rest::SUSPECT;
    let told = found.diagnosis.cause.remainder.as_ref().unwrap().description.as_ref().unwrap();
    let said = summary(found);
    assert!(said.contains(&format!("It looks like {}.", told.sentence)), "{said}");
}

#[test]
fn caveats_of_nuisances_name_the_remedy() {
    let nuisance = || "input_offset:u".to_owned();
    let beyond = Caveat::NuisanceBeyondPrior {
        nuisance: nuisance(),
        value: "0.6".into(),
        log: "a.csv".into(),
        std: "0.05".into(),
    };
    assert!(
        beyond.to_string().contains("a.csv, more than three times its `std` of 0.05: widen that"),
        "{beyond}"
    );
    let alike = Caveat::NuisanceAlike { nuisance: nuisance(), value: "0.3".into() };
    assert!(alike.to_string().contains("alike in all logs"), "{alike}");
}
