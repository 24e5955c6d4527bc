//! The order of effects on one channel. A gain acts first; a limit, dead zone or offset in the channel's unit would have another size before the gain.
//!
//! Equation: limit(g·u, L) = g·limit(u, L/g) for g > 0, and the same for dead zones, play, rates and offsets.

use crate::format::caveat::Caveat;
use crate::format::found::FoundEffect;

/// Gains, each with the effects that act after it and whose parameters are all in the channel's unit, or in that per second.
const SIZES: [(&str, &[&str]); 2] = [
    ("input_gain", &["input_offset", "deadband", "backlash", "saturation", "rate_limit"]),
    ("sensor_gain", &["sensor_bias", "sensor_drift", "sensor_saturation", "sensor_quantisation"]),
];

/// The sizes in the other order, where they differ by more than their interval.
pub(crate) fn order_caveats(effects: &[FoundEffect]) -> Vec<Caveat> {
    let mut caveats = Vec::new();
    for (name, sized) in SIZES {
        for gain in effects.iter().filter(|e| e.effect == name) {
            let factor = gain.parameters.iter().find(|p| p.name == "gain").and_then(|p| p.value);
            let Some(factor) = factor.filter(|g| *g > 0.0 && g.is_finite()) else { continue };
            let on = |e: &&FoundEffect| gain.channel == "*" || e.channel == gain.channel;
            let after = effects.iter().filter(|e| sized.contains(&e.effect.as_str()));
            for other in after.filter(on) {
                caveats.extend(in_other_order(gain, factor, other));
            }
        }
    }
    caveats
}

/// Every parameter of an effect that would be another before the gain.
fn in_other_order<'a>(
    gain: &'a FoundEffect,
    factor: f64,
    sized: &'a FoundEffect,
) -> impl Iterator<Item = Caveat> + 'a {
    sized.parameters.iter().filter_map(move |p| {
        let value = p.value?;
        let before = value / factor;
        let known = p.ci95.is_some_and(|[low, high]| (low..=high).contains(&before));
        (before.is_finite() && !known).then(|| Caveat::Order {
            first: gain.effect.clone(),
            second: sized.effect.clone(),
            channel: sized.channel.clone(),
            parameter: p.name.clone(),
            value,
            before,
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::found::FoundParameter;

    fn found(effect: &str, channel: &str, parameter: &str, value: f64, std: f64) -> FoundEffect {
        let ci95 = Some([value - 2.0 * std, value + 2.0 * std]);
        let unit = "1".to_owned();
        let (value, std) = (Some(value), Some(std));
        let parameters =
            vec![FoundParameter { name: parameter.to_owned(), unit, value, std, ci95 }];
        FoundEffect { effect: effect.to_owned(), channel: channel.to_owned(), parameters }
    }

    #[test]
    fn a_size_behind_a_gain_is_given_in_both_orders_where_they_differ() {
        let gain = found("input_gain", "u", "gain", 0.8, 0.01);
        let rate = |std| found("rate_limit", "u", "rate", 6.2, std);
        let caveats = order_caveats(&[gain.clone(), rate(0.1)]);
        let Some(Caveat::Order { before, .. }) = caveats.first() else { panic!("{caveats:?}") };
        assert!((before - 7.75).abs() < 1e-12 && caveats.len() == 1);
        // Within its interval, on another channel, of another kind.
        assert!(order_caveats(&[gain.clone(), rate(1.0)]).is_empty());
        assert!(
            order_caveats(&[gain.clone(), found("rate_limit", "v", "rate", 6.2, 0.1)]).is_empty()
        );
        assert!(
            order_caveats(&[gain, found("actuator_lag", "u", "time_constant", 6.2, 0.1)])
                .is_empty()
        );
        let all = found("sensor_gain", "*", "gain", 2.0, 0.01);
        assert_eq!(order_caveats(&[all, found("sensor_bias", "y", "offset", 1.0, 0.1)]).len(), 1);
    }
}
