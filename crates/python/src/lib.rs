//! The native half of the Python package: faces of the crate's types and functions, one file per mirrored module. They only delegate; the public functions,
//! with their defaults and the types of other packages, are in `python/deadtime`.

mod blind;
mod bound;
#[cfg(feature = "cli")]
mod command;
mod compare;
mod convert;
mod delay;
mod diagnose;
mod effect;
mod error;
mod export;
mod file;
mod identify;
mod linear;
mod log;
mod model;
mod response;
mod signal;
mod simulate;
mod state_space;
mod structure;
mod study;
mod track;
mod work;

/// The content of `deadtime._native`.
#[pyo3::pymodule(name = "_native")]
mod native {
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::blind::{_blind_case, _blind_cases, _blind_run, BlindScore};
    #[pymodule_export]
    use super::bound::{
        _anomaly_probability, _first_order_step, _joint, _known_model, _reference,
        _reference_white, _two_sensors, _two_sensors_white, _with_anomalies, _ziv_zakai,
    };
    #[cfg(feature = "cli")]
    #[pymodule_export]
    use super::command::_command;
    #[pymodule_export]
    use super::compare::_compare;
    #[pymodule_export]
    use super::delay::{
        _estimate, _estimate_events, _estimate_response, _expected, _impulse_response, _methods,
        _of_arrays, _of_step,
    };
    #[pymodule_export]
    use super::diagnose::{_check, _gap, _isolability, PyDiagnosed, PySimulator};
    #[pymodule_export]
    use super::effect::_effects;
    #[pymodule_export]
    use super::export::{_export, _targets};
    #[pymodule_export]
    use super::file::{_read_text, _write_whole, Lock};
    #[pymodule_export]
    use super::identify::_identify;
    #[pymodule_export]
    use super::linear::{
        _care, _connect, _era, _filter, _gdare, _lqr, _lyap, _markov, _norm_h2, _norm_linf,
        _nu_gap, _pade, _thiran,
    };
    #[pymodule_export]
    use super::log::{_name_and_unit, _of_columns, Log};
    #[pymodule_export]
    use super::model::{_model, _uav, Model};
    #[pymodule_export]
    use super::response::_frequency_response;
    #[pymodule_export]
    use super::signal::{_add_noise, _excitations, _excite, _of_channel};
    #[pymodule_export]
    use super::simulate::{_c2d, _conversions, _d2c, _dare, _dlqr, _lsim, _same_time, _simulate};
    #[pymodule_export]
    use super::state_space::{_transfer_function, StateSpace, TransferFunction};
    #[pymodule_export]
    use super::structure::{_identify_structure, _match_structure};
    #[pymodule_export]
    use super::study::{
        _estimates, _plans, _plants, _study, GateReport, Plan, Runner, StudyResult, Tasks,
    };
    #[pymodule_export]
    use super::track::Running;
    #[pymodule_export]
    use super::work::_busy;

    #[pymodule_init]
    fn init(m: &Bound<'_, PyModule>) -> PyResult<()> {
        m.add("__version__", env!("CARGO_PKG_VERSION"))?;
        m.add("ERROR_CLASSES", super::error::CLASSES)?;
        // The list of names that a module keeps is for `import *`, which is not used here.
        m.delattr("__all__")
    }
}
