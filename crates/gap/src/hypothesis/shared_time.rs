//! The time that several changes share: one event.
//!
//! Instants of a set's effects that are equal to the last bit are one parameter. The first of them is fitted, and the others follow it. Changes of one event thus cost one
//! time, and the score decides between one event and several.

use deadtime_model::effect::{Applied, Role};

/// Effect and place of a parameter.
type At = (usize, usize);

/// All instants of a set, in order.
pub(crate) fn instants(effects: &[Applied]) -> Vec<At> {
    let of = |(e, a): (usize, &Applied)| {
        let instant = |(i, _): &(usize, _)| a.parameters[*i].role == Role::Instant;
        a.values.iter().enumerate().filter(instant).map(|(i, _)| (e, i)).collect::<Vec<_>>()
    };
    effects.iter().enumerate().flat_map(of).collect()
}

fn value(effects: &[Applied], (e, i): At) -> u64 {
    effects[e].values[i].to_bits()
}

fn is_instant(effects: &[Applied], (e, i): At) -> bool {
    effects[e].parameters[i].role == Role::Instant
}

/// Two parameters are one: the same place, or instants of one event.
pub(crate) fn is_same(effects: &[Applied], a: At, b: At) -> bool {
    let instants = || is_instant(effects, a) && is_instant(effects, b);
    a == b || (instants() && value(effects, a) == value(effects, b))
}

/// The parameter that is fitted in the place of this one: the first instant of the same event, or the parameter itself.
pub(crate) fn leading(effects: &[Applied], at: At) -> At {
    instants(effects).into_iter().find(|other| is_same(effects, *other, at)).unwrap_or(at)
}

/// Gives a parameter a value; instants of the same event follow.
pub(crate) fn put(effects: &mut [Applied], at: At, new: f64) {
    if is_instant(effects, at) {
        let old = value(effects, at);
        for (e, i) in instants(effects) {
            if value(effects, (e, i)) == old {
                effects[e].values[i] = new;
            }
        }
    }
    effects[at.0].values[at.1] = new;
}

/// The same effects with the two closest events merged, at the time of either. Empty where there is one event at most.
pub(crate) fn joined(effects: &[Applied]) -> Vec<Vec<Applied>> {
    let mut events: Vec<At> =
        instants(effects).into_iter().filter(|at| leading(effects, *at) == *at).collect();
    let time = |(e, i): At| effects[e].values[i];
    events.sort_by(|a, b| time(*a).total_cmp(&time(*b)));
    let closest = events
        .windows(2)
        .min_by(|a, b| (time(a[1]) - time(a[0])).total_cmp(&(time(b[1]) - time(b[0]))));
    let Some(&[a, b]) = closest else { return Vec::new() };
    let with = |(at, new): (At, f64)| {
        let mut together = effects.to_vec();
        put(&mut together, at, new);
        together
    };
    [(b, time(a)), (a, time(b))].map(with).to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use deadtime_model::ModelDocument;
    use deadtime_model::effect::find;
    use deadtime_model::simulate::System;

    const MODEL: &str = r#"
format = "deadtime/model@1"
name = "lag"
kind = "lti"
inputs = [{ name = "u" }, { name = "v" }, { name = "w" }]
states = [{ name = "x" }]
outputs = [{ name = "y" }]
A = [[-1.0]]
B = [[1.0, 1.0, 1.0]]
C = [[1.0]]
D = [[0.0, 0.0, 0.0]]
"#;

    /// A jump of the gain of each input, at these times.
    fn jumps(times: [f64; 3]) -> Vec<Applied> {
        let document = ModelDocument::from_toml(MODEL, std::path::Path::new("lag.toml")).unwrap();
        let system = System::new(&document, |_| Ok(0.0)).unwrap();
        let jump = |(channel, time): (&str, f64)| {
            let nominal = Applied::nominal(&system, find("gain_jump").unwrap(), channel).unwrap();
            Applied { values: vec![1.0, time, 2.0], ..nominal }
        };
        ["u", "v", "w"].into_iter().zip(times).map(jump).collect()
    }

    fn times(effects: &[Applied]) -> Vec<f64> {
        effects.iter().map(|a| a.values[1]).collect()
    }

    #[test]
    fn instants_that_are_equal_are_one_parameter() {
        let mut effects = jumps([5.0, 3.0, 5.0]);
        assert_eq!(leading(&effects, (2, 1)), (0, 1));
        assert_eq!(leading(&effects, (1, 1)), (1, 1));
        // Equal values of parameters that are no times are a coincidence.
        assert_eq!(leading(&effects, (2, 0)), (2, 0));
        put(&mut effects, (0, 1), 4.0);
        put(&mut effects, (2, 0), 7.0);
        assert_eq!(times(&effects), [4.0, 3.0, 4.0]);
        assert_eq!((effects[0].values[0], effects[2].values[0]), (1.0, 7.0));
    }

    #[test]
    fn the_closest_events_are_joined_first() {
        let both: Vec<Vec<f64>> =
            joined(&jumps([5.0, 3.0, 4.5])).iter().map(|e| times(e)).collect();
        assert_eq!(both, [[4.5, 3.0, 4.5], [5.0, 3.0, 5.0]]);
        let both: Vec<Vec<f64>> =
            joined(&jumps([5.0, 3.0, 5.0])).iter().map(|e| times(e)).collect();
        assert_eq!(both, [[3.0, 3.0, 3.0], [5.0, 5.0, 5.0]]);
        assert!(joined(&jumps([3.0, 3.0, 3.0])).is_empty());
    }
}
