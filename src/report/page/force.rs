//! The residual of a gap as a missing force, over the variable that it depends on.

use serde_json::{Value, json};

use super::series::briefly;
use deadtime_gap::ForceProfile;

/// The figure; `None` where nothing is reported.
pub(super) fn figure(force: Option<&ForceProfile>) -> Option<Value> {
    let force = force?;
    let side = |end: usize| briefly(force.ci95.iter().map(|interval| interval[end]));
    let view = json!({
        "kind": "lines", "keys": [format!("{} over {}", force.state, force.over)],
        "about": format!("Force missing on the derivative of {} over {}", force.state, force.over),
        "x": { "label": force.over, "values": briefly(force.at.iter().copied()), "tight": true },
        "y": { "label": format!("missing on the derivative of {}", force.state) },
        "curves": [
            { "label": "fitted, straight between knots", "y": briefly(force.force.iter().copied()), "low": side(0), "high": side(1), "color": "after", "points": false, "width": 2.2 },
            { "label": format!("k*{}", force.told), "y": briefly(force.law.iter().copied()), "color": "before", "dash": [3, 4], "points": false },
        ],
    });
    Some(json!({ "id": "missing", "pick": ["force"], "views": [view] }))
}
