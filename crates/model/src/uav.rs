//! The quadrotor of the thesis behind this project: four decoupled dynamics about hover.
//!
//! States [v p φ | u q θ | r ψ | w], inputs [δlat δlon δdir δver]. Outputs [p ay | q ax | r | az]. SI units, g = 9.81 m/s².

use nalgebra::DMatrix;

use super::state_space::{Continuous, StateSpace};

const G: f64 = 9.81;
/// Lateral derivatives: Yv, Yp, Lv, Lp, Yδ, Lδ.
const LATERAL: [f64; 6] = [-0.211, 0.0, -3.613, 0.0, 9.379, 851.287];
/// Longitudinal derivatives: Xu, Xq, Mu, Mq, Xδ, Mδ.
const LONGITUDINAL: [f64; 6] = [-0.282, 0.0, 6.297, 0.0, -8.758, 473.061];
/// Directional derivatives: Nr, Nδ.
const DIRECTIONAL: [f64; 2] = [-8.178, 255.59];
/// Vertical derivatives: Zw, Zδ.
const VERTICAL: [f64; 2] = [-0.731, -34.35];

/// One of the four dynamics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Dynamics {
    /// v, p, φ from δlat; unstable.
    Lateral,
    /// u, q, θ from δlon; unstable.
    Longitudinal,
    /// r, ψ from δdir.
    Directional,
    /// w from δver.
    Vertical,
}

impl Dynamics {
    /// All four, in the order of the state vector.
    pub const ALL: [Self; 4] =
        [Self::Lateral, Self::Longitudinal, Self::Directional, Self::Vertical];

    /// The name used in files and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Lateral => "lateral",
            Self::Longitudinal => "longitudinal",
            Self::Directional => "directional",
            Self::Vertical => "vertical",
        }
    }

    /// Input name (unit 1).
    #[must_use]
    pub fn input(self) -> &'static str {
        match self {
            Self::Lateral => "delta_lat",
            Self::Longitudinal => "delta_lon",
            Self::Directional => "delta_dir",
            Self::Vertical => "delta_ver",
        }
    }

    /// State names and units.
    #[must_use]
    pub fn states(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Self::Lateral => &[("v", "m/s"), ("p", "rad/s"), ("phi", "rad")],
            Self::Longitudinal => &[("u", "m/s"), ("q", "rad/s"), ("theta", "rad")],
            Self::Directional => &[("r", "rad/s"), ("psi", "rad")],
            Self::Vertical => &[("w", "m/s")],
        }
    }

    /// Output names and units.
    #[must_use]
    pub fn outputs(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Self::Lateral => &[("p", "rad/s"), ("ay", "m/s^2")],
            Self::Longitudinal => &[("q", "rad/s"), ("ax", "m/s^2")],
            Self::Directional => &[("r", "rad/s")],
            Self::Vertical => &[("az", "m/s^2")],
        }
    }

    /// A, B, C, D.
    fn matrices(self) -> [DMatrix<f64>; 4] {
        let m = DMatrix::from_row_slice;
        match self {
            Self::Lateral | Self::Longitudinal => {
                let ([force_v, force_w, moment_v, moment_w, force_d, moment_d], gravity) =
                    if self == Self::Lateral { (LATERAL, G) } else { (LONGITUDINAL, -G) };
                [
                    m(3, 3, &[force_v, force_w, gravity, moment_v, moment_w, 0.0, 0.0, 1.0, 0.0]),
                    m(3, 1, &[force_d, moment_d, 0.0]),
                    m(2, 3, &[0.0, 1.0, 0.0, force_v, force_w, 0.0]),
                    m(2, 1, &[0.0, force_d]),
                ]
            }
            Self::Directional => {
                let [damping, control] = DIRECTIONAL;
                [
                    m(2, 2, &[damping, 0.0, 1.0, 0.0]),
                    m(2, 1, &[control, 0.0]),
                    m(1, 2, &[1.0, 0.0]),
                    m(1, 1, &[0.0]),
                ]
            }
            Self::Vertical => {
                let [damping, control] = VERTICAL;
                [m(1, 1, &[damping]), m(1, 1, &[control]), m(1, 1, &[damping]), m(1, 1, &[control])]
            }
        }
    }

    /// The continuous model of these dynamics alone.
    #[must_use]
    pub fn model(self) -> StateSpace<Continuous> {
        build(self.matrices())
    }
}

/// All nine states, four inputs and six outputs.
#[must_use]
pub fn model() -> StateSpace<Continuous> {
    let parts = Dynamics::ALL.map(Dynamics::matrices);
    build([0, 1, 2, 3].map(|which| {
        let rows = parts.iter().map(|p| p[which].nrows()).sum();
        let columns = parts.iter().map(|p| p[which].ncols()).sum();
        let mut whole = DMatrix::zeros(rows, columns);
        let mut at = (0, 0);
        for part in &parts {
            whole.view_mut(at, part[which].shape()).copy_from(&part[which]);
            at = (at.0 + part[which].nrows(), at.1 + part[which].ncols());
        }
        whole
    }))
}

fn build([a, b, c, d]: [DMatrix<f64>; 4]) -> StateSpace<Continuous> {
    // Invariant: the shapes and values above are matching constants; the tests build all of them.
    #[allow(clippy::expect_used)]
    StateSpace::continuous(a, b, c, d).expect("the constant matrices fit each other")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lateral_and_longitudinal_are_unstable_the_others_are_not() {
        assert!(!Dynamics::Lateral.model().is_stable());
        assert!(!Dynamics::Longitudinal.model().is_stable());
        // Directional has a pole at 0 (ψ), which is not observable: marginal, and r alone is stable.
        assert!(Dynamics::Directional.model().poles().iter().all(|p| p.re <= 0.0));
        assert!(Dynamics::Vertical.model().is_stable());
        assert!(!model().is_stable());
    }

    #[test]
    fn the_whole_vehicle_has_nine_states_four_inputs_six_outputs() {
        let whole = model();
        assert_eq!((whole.order(), whole.inputs(), whole.outputs()), (9, 4, 6));
        assert_eq!(whole.d()[(1, 0)], 9.379);
        assert_eq!(whole.a()[(3, 5)], -G);
    }

    #[test]
    fn relative_degrees_are_those_of_the_equations() {
        let lateral = Dynamics::Lateral.model();
        assert_eq!(lateral.relative_degree(0, 0), Some(1));
        assert_eq!(lateral.relative_degree(1, 0), Some(0));
        assert_eq!(Dynamics::Directional.model().relative_degree(0, 0), Some(1));
        assert_eq!(Dynamics::Vertical.model().relative_degree(0, 0), Some(0));
        let whole = model();
        assert_eq!(whole.relative_degree(0, 3), None);
        assert!(matches!(
            whole.transfer_function(0, 3),
            Err(crate::error::ModelError::ZeroTransfer { .. })
        ));
    }

    #[test]
    fn transfer_functions_agree_with_the_state_space_model() {
        for dynamics in Dynamics::ALL {
            let sys = dynamics.model();
            for output in 0..sys.outputs() {
                let tf = sys.transfer_function(output, 0).unwrap();
                for omega in [0.01, 0.5, 3.0, 40.0] {
                    let exact = sys.frequency_response(omega)[(output, 0)];
                    let got = tf.frequency_response(omega);
                    assert!(
                        (got - exact).norm() <= 1e-11 * exact.norm(),
                        "{dynamics:?} {output} {omega}: {got} {exact}"
                    );
                    let back = tf.to_state_space().unwrap().frequency_response(omega)[(0, 0)];
                    assert!(
                        (back - exact).norm() <= 1e-11 * exact.norm(),
                        "{dynamics:?} {output} {omega}: {back} {exact}"
                    );
                }
            }
        }
    }
}
