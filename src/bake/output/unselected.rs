//! Volumes and planes that a selection of frames leaves out of a bake.

use crate::recipe::scene::VdbGrid;
use crate::recipe::{Recipe, word_of};
use osier_base::diagnostic::{Diagnostic, Report};

/// X028 for each plane or volume of the wind and of a flight that is due at none of the selected frames. It depends on the recipe
/// alone, so that a bake warns before it simulates. `frames`: numbers of the frames to write; empty for a still scene.
pub(crate) fn warn_of_unselected_grids(recipe: &Recipe, frames: &[u32]) -> Report {
    let mut report = Report::default();
    if frames.is_empty() {
        return report;
    }
    let start = recipe.clip.start;
    let mut warn_if_missed = |label: String, every: u32| {
        if !frames.iter().any(|number| number.saturating_sub(start).is_multiple_of(every.max(1))) {
            let text = format!("{label}: written every {every} frames from frame {start} on, which are not selected");
            report.push(Diagnostic::about("X028", text));
        }
    };
    // The grids of OpenVDB files, in the order in which a scene has them: that of the wind, then those of the flight.
    let output = &recipe.output;
    let velocity = output.velocity_volume().filter(|_| recipe.blows()).map(|domain| (VdbGrid::Velocity, domain));
    let catkins = output.vdb.domain.as_ref().filter(|_| output.writes_vdb() && recipe.flight.is_some());
    let counts = [VdbGrid::Density, VdbGrid::Deposition].into_iter().filter(|g| output.vdb.keys.grids.contains(g));
    let of_catkins = counts.filter_map(|grid| catkins.map(|domain| (grid, domain)));
    for (grid, domain) in velocity.into_iter().chain(of_catkins) {
        warn_if_missed(format!("volume {}", word_of(grid)), domain.every);
    }
    for grid in &output.wind.grids {
        warn_if_missed(format!("wind {}", grid.name), grid.every);
    }
    report
}
