//! Quantities inside a model as channels of effects.

use std::sync::Arc;

use crate::effect::definition::OnChannel;
use crate::effect::error::{EffectError, Result};
use crate::effect::scales::{Scales, Spread};
use crate::equations::error::EquationError;
use crate::equations::system::Equations;
use crate::simulate::plan::Plan;
use crate::simulate::simulator::Port;
use crate::simulate::system::{Dynamics, System};

/// The description of these channels.
pub(super) const RULE: &str =
    "a named expression or a term in which an input is compared with a state: `kp*(target - q)`";

/// The description of the links between two bodies.
pub(super) const LINKS_RULE: &str =
    "a difference of two positions in the equations: `motor - load`";

/// The equations of a continuous model.
fn equations(system: &System) -> Option<&Equations> {
    match &system.dynamics {
        Dynamics::Equations(equations, _) => Some(equations),
        _ => None,
    }
}

/// The outputs of controllers inside the model.
pub(super) fn controls(system: &System) -> Vec<String> {
    equations(system).map(Equations::controls).unwrap_or_default()
}

/// The twists of links between two bodies.
pub(super) fn links(system: &System) -> Vec<String> {
    equations(system).map(Equations::links).unwrap_or_default()
}

impl<'a> OnChannel<'a> {
    /// The unit of the quantity, which the model does not specify.
    ///
    /// # Errors
    /// [`EffectError::Channel`] where the channel is no quantity of the model.
    pub(super) fn quantity(self) -> Result<String> {
        let open = equations(self.system)
            .and_then(|equations| equations.with_shown_quantity(self.channel).ok().flatten());
        open.map(|_| format!("[{}]", self.channel)).ok_or_else(|| self.unknown())
    }

    /// The first position of a link, which has the unit of the twist.
    ///
    /// # Errors
    /// [`EffectError::Channel`] where the channel is no link of the model.
    pub(super) fn position(self) -> Result<&'a Port> {
        self.quantity()?;
        let first = self.channel.split('-').next().map(str::trim).unwrap_or_default();
        self.system.states.iter().find(|s| s.name == first).ok_or_else(|| self.unknown())
    }

    /// The spread of the quantity in the nominal motion.
    pub(super) fn quantity_spread(self, scales: &Scales) -> Option<&Spread> {
        scales.inner.iter().find(|(name, _)| name == self.channel).map(|(_, spread)| spread)
    }

    /// Replaces the plan's equations; the new parameters follow all others.
    ///
    /// # Errors
    /// [`EffectError::Channel`] where the channel is no quantity of the model.
    pub(super) fn rewrite(
        self,
        plan: &mut Plan,
        rewrite: impl Fn(&Equations) -> Result<Option<Equations>, EquationError>,
        values: &[f64],
    ) -> Result<(), EffectError> {
        let Dynamics::Equations(equations, parameters) = &mut plan.dynamics else {
            return Err(self.unknown());
        };
        let rewritten = rewrite(equations).ok().flatten().ok_or_else(|| self.unknown())?;
        *equations = Arc::new(rewritten);
        parameters.extend_from_slice(values);
        Ok(())
    }
}

/// Initial time constants inside a loop: one per two octaves, from half a sample on. A loop slower than the longest would be unstable.
pub(super) fn times(scales: &Scales) -> Vec<Vec<f64>> {
    let longest = scales.longest_delay_s.min(10.0 * scales.timescale_s.max(scales.sample_time_s));
    let mut time_s = 0.5 * scales.sample_time_s;
    let mut times = Vec::new();
    while time_s <= longest && times.len() < 8 {
        times.push(vec![time_s]);
        time_s *= 4.0;
    }
    times
}

/// The shortest time of the search, in samples.
pub(super) const LEAST: f64 = 0.02;

#[cfg(test)]
mod tests {
    use crate::effect::applied::{Applied, Chance};
    use crate::effect::effects::find;
    use crate::file::document::ModelDocument;
    use crate::simulate::plan::InnerFilter;
    use crate::simulate::run::Commands;
    use crate::simulate::system::System;
    use crate::simulate::{Correction, Measured};
    use std::num::NonZeroUsize;

    /// A position loop; `torque` replaces the controller's torque in its second equation.
    fn servo(definitions: &str, torque: &str) -> System {
        system(&format!(
            r#"
format = "deadtime/model@1"
name = "servo"
kind = "equations"
inputs = [{{ name = "target" }}]
outputs = [{{ name = "q" }}]
[states]
q = {{ initial = 0.1 }}
w = {{ initial = 0.0 }}
[parameters]
kp = {{ value = 12.0 }}
d = {{ value = 0.7 }}
j = {{ value = 0.05 }}
g = {{ value = 0.4 }}
{definitions}
[derivatives]
q = "w"
w = "({torque} - g*cos(q) - d*w)/j"
[output_equations]
q = "q"
"#
        ))
    }

    fn system(text: &str) -> System {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.toml");
        std::fs::write(&path, text).unwrap();
        System::new(&ModelDocument::read(&path).unwrap(), |_| Ok(0.0)).unwrap()
    }

    fn with(system: &System, effect: &str, channel: &str, values: &[f64]) -> Applied {
        let nominal = Applied::nominal(system, find(effect).unwrap(), channel).unwrap();
        Applied { values: values.to_vec(), ..nominal }
    }

    const SAMPLE_S: f64 = 0.02;

    fn commands() -> (Vec<f64>, Vec<f64>) {
        let time_s: Vec<f64> = (0..150).map(|k| SAMPLE_S * f64::from(k)).collect();
        let level =
            |k: usize| [0.0, 0.8, -0.3, 0.25, -0.7][k / 30] + if k % 30 < 15 { 0.1 } else { 0.0 };
        let u = (0..150).map(level).collect();
        (time_s, u)
    }

    fn simulated(system: &System, effects: &[Applied], x0: &[f64]) -> Vec<f64> {
        let (time_s, u) = commands();
        let plan = Applied::plan(system, effects, Chance::Mean).unwrap();
        let commands = Commands { time_s: &time_s, inputs: std::slice::from_ref(&u) };
        system.simulate(&plan, commands, x0, None).unwrap().y.column(0).iter().copied().collect()
    }

    /// Midpoint steps of 1/200 sample. Position, speed and the lag's state follow the torque of `arrives`, from the raw torque and the means of all earlier
    /// steps, newest last.
    fn stepped(arrives: impl Fn(f64, f64, &[f64]) -> f64, lag_s: Option<f64>) -> Vec<f64> {
        let (_, u) = commands();
        let (h, steps) = (SAMPLE_S / 200.0, 200);
        let (mut x, mut past) = ([0.1, 0.0, 12.0 * (u[0] - 0.1)], Vec::new());
        let mut y = Vec::new();
        for target in u {
            y.push(x[0]);
            for _ in 0..steps {
                let raw = |x: &[f64; 3]| 12.0 * (target - x[0]);
                let begun = raw(&x);
                let rate = |x: &[f64; 3]| {
                    let torque = arrives(raw(x), x[2], &past);
                    let lag = lag_s.map_or(0.0, |lag| (raw(x) - x[2]) / lag);
                    [x[1], (torque - 0.4 * x[0].cos() - 0.7 * x[1]) / 0.05, lag]
                };
                let by = |x: &[f64; 3], d: [f64; 3], h: f64| [0, 1, 2].map(|i| x[i] + h * d[i]);
                let middle = by(&x, rate(&x), 0.5 * h);
                x = by(&x, rate(&middle), h);
                past.push(0.5 * (begun + 12.0 * (target - x[0])));
            }
        }
        y
    }

    fn furthest(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn quantities_are_found_by_name_and_by_their_own_text() {
        let channels = |s: &System| find("internal_saturation").unwrap().channels(s);
        assert_eq!(channels(&servo("", "kp*(target - q)")), ["kp*(target - q)"]);
        assert_eq!(channels(&servo("", "(kp*(target - q))")), ["kp*(target - q)"]);
        let named = "[definitions]\nerror = \"target - q\"\ntorque = \"kp*error - 0.1*w\"";
        assert_eq!(channels(&servo(named, "torque")), ["error", "torque"]);
        // A command without a comparison is an input, and a bare difference is the whole law.
        assert!(channels(&servo("", "target")).is_empty());
        assert!(channels(&servo("", "kp*target*cos(q)")).is_empty());
    }

    #[test]
    fn limits_and_dead_zones_act_on_the_quantity_alone() {
        for (definitions, torque) in
            [("", "kp*(target - q)"), ("[definitions]\ntorque = \"kp*(target - q)\"", "torque")]
        {
            let system = servo(definitions, torque);
            let channel = &find("internal_saturation").unwrap().channels(&system)[0];
            let limited = simulated(
                &system,
                &[with(&system, "internal_saturation", channel, &[-2.0, 2.5])],
                &[0.1, 0.0],
            );
            let own = stepped(|raw, _, _| raw.clamp(-2.0, 2.5), None);
            assert!(furthest(&limited, &own) < 1e-5, "{}", furthest(&limited, &own));
            let dead = simulated(
                &system,
                &[with(&system, "internal_deadband", channel, &[0.6])],
                &[0.1, 0.0],
            );
            let own = stepped(|raw, _, _| raw - raw.clamp(-0.6, 0.6), None);
            assert!(furthest(&dead, &own) < 1e-5, "{}", furthest(&dead, &own));
            assert!(furthest(&dead, &limited) > 0.1);
        }
    }

    #[test]
    fn lags_and_delays_inside_a_loop_are_those_of_their_formulas() {
        for (definitions, torque) in
            [("", "kp*(target - q)"), ("[definitions]\ntorque = \"kp*(target - q)\"", "torque")]
        {
            let system = servo(definitions, torque);
            let channel = &find("internal_lag").unwrap().channels(&system)[0];
            let lagged =
                simulated(&system, &[with(&system, "internal_lag", channel, &[0.03])], &[0.1, 0.0]);
            let own = stepped(|_, lagged, _| lagged, Some(0.03));
            assert!(furthest(&lagged, &own) < 1e-5, "{}", furthest(&lagged, &own));
            // 300 steps of the comparison; at rest before.
            let late = simulated(
                &system,
                &[with(&system, "internal_delay", channel, &[0.03])],
                &[0.1, 0.0],
            );
            let before = |past: &[f64]| past.len().checked_sub(300).map_or(0.0, |at| past[at]);
            let own = stepped(|_, _, past| before(past), None);
            assert!(furthest(&late, &own) < 1e-5, "{}", furthest(&late, &own));
            assert!(furthest(&late, &lagged) > 0.02);
        }
    }

    /// A lag or dead time of any length is simulated. The effect shrinks with its length, at most 40 /s at these commands, down to the integrator's own error.
    #[test]
    fn times_of_every_length_move_the_outputs_by_what_they_are() {
        let system = servo("", "kp*(target - q)");
        let inner = &find("internal_lag").unwrap().channels(&system)[0];
        let nominal = simulated(&system, &[], &[0.1, 0.0]);
        for (effect, channel) in [
            ("internal_lag", inner.as_str()),
            ("internal_delay", inner.as_str()),
            ("actuator_lag", "target"),
            ("sensor_lag", "q"),
        ] {
            for exponent in -300..-1 {
                let time_s = 10f64.powi(exponent) * 3.7;
                let moved =
                    simulated(&system, &[with(&system, effect, channel, &[time_s])], &[0.1, 0.0]);
                let far = furthest(&moved, &nominal);
                assert!(far < 40.0 * time_s + 1e-6, "{effect} of {time_s:e} s: {far}");
            }
        }
    }

    /// A restarted run continues with the delayed values still in transit.
    #[test]
    fn predictions_over_a_horizon_know_what_is_on_its_way() {
        let system = servo("", "kp*(target - q)");
        let channel = &find("internal_delay").unwrap().channels(&system)[0];
        let (time_s, u) = commands();
        let commands = Commands { time_s: &time_s, inputs: std::slice::from_ref(&u) };
        for friction in [false, true] {
            let mut effects = vec![
                with(&system, "internal_delay", channel, &[0.053]),
                with(&system, "internal_saturation", channel, &[-3.0, 5.0]),
            ];
            if friction {
                effects.push(with(&system, "coulomb_friction", "w", &[2.0]));
            }
            let plan = Applied::plan(&system, &effects, Chance::Mean).unwrap();
            let measured = [Measured { values: vec![0.0; time_s.len()], present: None }];
            let gain = nalgebra::DMatrix::zeros(2, 1);
            let horizon = NonZeroUsize::new(7);
            let nothing = Correction { gain: &gain, measured: &measured, horizon };
            let free = system.simulate(&plan, commands, &[0.1, 0.0], None).unwrap().y;
            let again = system.simulate(&plan, commands, &[0.1, 0.0], Some(nothing)).unwrap().y;
            assert!(free.iter().zip(again.iter()).all(|(a, b)| (a - b).abs() < 1e-6));
        }
    }

    /// A quantity with limits and a lag is limited first.
    #[test]
    fn limits_come_before_a_lag_of_the_same_quantity() {
        for (definitions, torque) in
            [("", "kp*(target - q)"), ("[definitions]\ntorque = \"kp*(target - q)\"", "torque")]
        {
            let system = servo(definitions, torque);
            let channel = &find("internal_lag").unwrap().channels(&system)[0];
            let both = [
                with(&system, "internal_lag", channel, &[0.03]),
                with(&system, "internal_saturation", channel, &[-2.0, 2.5]),
            ];
            let y = simulated(&system, &both, &[0.1, 0.0]);
            // The initial state of the comparison's lag is an unlimited torque, within the limits here.
            let (_, u) = commands();
            let (h, mut x) = (SAMPLE_S / 200.0, [0.1, 0.0, 12.0 * (u[0] - 0.1)]);
            let mut own = Vec::new();
            for target in u {
                own.push(x[0]);
                for _ in 0..200 {
                    let rate = |x: &[f64; 3]| {
                        let limited = (12.0 * (target - x[0])).clamp(-2.0, 2.5);
                        [
                            x[1],
                            (x[2] - 0.4 * x[0].cos() - 0.7 * x[1]) / 0.05,
                            (limited - x[2]) / 0.03,
                        ]
                    };
                    let d = rate(&x);
                    let middle = [0, 1, 2].map(|i| x[i] + 0.5 * h * d[i]);
                    let d = rate(&middle);
                    x = [0, 1, 2].map(|i| x[i] + h * d[i]);
                }
            }
            assert!(furthest(&y, &own) < 1e-5, "{}", furthest(&y, &own));
        }
    }

    /// Phase and magnitude of the approximant against exp(−s·delay), to the accuracy stated on the effect's page.
    #[test]
    fn the_approximant_of_a_dead_time_is_close_up_to_three_radians() {
        let (time_s, over, under) = InnerFilter::Delay(0.5).transfer();
        let at = |c: &[f64], omega: f64| {
            let power = |k: usize| {
                let size = (omega * time_s).powi(i32::try_from(k).unwrap());
                [[size, 0.0], [0.0, size], [-size, 0.0], [0.0, -size]][k % 4]
            };
            c.iter().enumerate().fold([0.0, 0.0], |sum, (k, c)| {
                let p = power(k);
                [sum[0] + c * p[0], sum[1] + c * p[1]]
            })
        };
        for omega in [0.5, 2.0, 4.0, 6.0] {
            let ([a, b], [c, d]) = (at(&over, omega), at(&under, omega));
            let phase = b.atan2(a) - d.atan2(c);
            let off = (phase + omega * time_s).rem_euclid(std::f64::consts::TAU);
            let off = off.min(std::f64::consts::TAU - off);
            let size = a.hypot(b) / c.hypot(d);
            assert!(
                off < 1e-3 * omega * time_s && (size - 1.0).abs() < 0.01,
                "{omega}: {off} {size}"
            );
        }
    }

    const TRAIN: &str = r#"
format = "deadtime/model@1"
name = "train"
kind = "equations"
inputs = [{ name = "u" }]
outputs = [{ name = "load" }]
[states]
motor = { initial = 0.0 }
load = { initial = 0.0 }
wm = { initial = 0.0 }
wl = { initial = 0.0 }
[parameters]
k = { value = 60.0 }
[derivatives]
motor = "wm"
load = "wl"
wm = "(u - k*(motor - load) - 0.3*wm)/0.05"
wl = "(k*(motor - load) - 2.0*load - 0.3*wl)/0.08"
[output_equations]
load = "load"
"#;

    /// The load of `TRAIN` by midpoint steps of 1/400 sample. The link's torque is 60 times the value of `link` at twist and relative speed.
    fn train_stepped(link: impl Fn(f64, f64) -> f64) -> Vec<f64> {
        let (_, u) = commands();
        let (h, mut x, mut own) = (SAMPLE_S / 400.0, [0.0f64; 4], Vec::new());
        for u in u {
            own.push(x[1]);
            for _ in 0..400 {
                let rate = |x: &[f64; 4]| {
                    let torque = 60.0 * link(x[0] - x[1], x[2] - x[3]);
                    [
                        x[2],
                        x[3],
                        (u - torque - 0.3 * x[2]) / 0.05,
                        (torque - 2.0 * x[1] - 0.3 * x[3]) / 0.08,
                    ]
                };
                let d = rate(&x);
                let middle = [0, 1, 2, 3].map(|i| x[i] + 0.5 * h * d[i]);
                let d = rate(&middle);
                x = [0, 1, 2, 3].map(|i| x[i] + h * d[i]);
            }
        }
        own
    }

    #[test]
    fn play_in_a_drive_train_lets_the_twist_go_free_and_friction_slows_it() {
        let train = system(TRAIN);
        let nominal = simulated(&train, &[], &[0.0; 4]);
        let of = |effect: &str, values: &[f64], link: &dyn Fn(f64, f64) -> f64| {
            assert_eq!(find(effect).unwrap().channels(&train), ["motor - load"]);
            let y = simulated(&train, &[with(&train, effect, "motor - load", values)], &[0.0; 4]);
            let own = train_stepped(link);
            assert!(furthest(&y, &own) < 1e-4, "{effect} {}", furthest(&y, &own));
            assert!(furthest(&y, &nominal) > 1e-3, "{effect}");
        };
        let play = |twist: f64, _: f64| twist - twist.clamp(-0.05, 0.05);
        of("driveline_backlash", &[0.05], &play);
        for (level, speed) in [(0.02, 0.1), (0.05, 0.02)] {
            let friction = |twist: f64, rate: f64| twist + level * (rate / speed).tanh();
            of("driveline_friction", &[level, speed], &friction);
        }
    }

    #[test]
    fn an_output_behind_play_follows_what_pushes_it() {
        let wire = system(
            r#"
format = "deadtime/model@1"
name = "wire"
kind = "lti"
inputs = [{ name = "u" }]
states = [{ name = "s" }]
outputs = [{ name = "y" }]
A = [[-1.0]]
B = [[0.0]]
C = [[0.0]]
D = [[1.0]]
"#,
        );
        let y = simulated(&wire, &[with(&wire, "output_backlash", "y", &[0.07])], &[0.0]);
        let (_, u) = commands();
        let mut position = u[0];
        for (y, u) in y.iter().zip(&u) {
            if u - position > 0.07 {
                position = u - 0.07;
            } else if position - u > 0.07 {
                position = u + 0.07;
            }
            assert!((y - position).abs() < 1e-12);
        }
    }
}
