//! Solids at two periodic sides of the box, through which air that leaves at one side enters at the other.

use glam::{DVec3, Vec3};

use super::setup::LatticeOptions;
use osier_base::Result;
use osier_base::diagnostic::Diagnostic;
use osier_scene::solid::{Form, Solid};

/// Refuses solids that cross one of two joined sides of the box (S039): the part beyond that side would be missing at the other.
/// Land has no bounds, and a solid that crosses both sides, such as a wall along the box, continues from one to the other.
pub(super) fn check_joined_sides(options: &LatticeOptions, solids: &[Solid]) -> Result<()> {
    let low = options.origin();
    let high = low + DVec3::from_array(options.cells.map(f64::from)) * options.spacing;
    // A solid that ends within half a cell of a side reaches no cell centre beyond it.
    let slack = options.spacing / 2.0;
    let joined = [0, 2].into_iter().zip(options.periodic_sides()).filter(|(_, joined)| *joined);
    for (axis, _) in joined {
        for solid in solids.iter().filter(|s| !matches!(s.form, Form::Land(_))) {
            let bounds = solid.bounds();
            let (from, to) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
            let reaches = |side: f64| from[axis] < side - slack && to[axis] > side + slack;
            // Most solids cross no side; their bounds are sufficient to show that, without a test of the triangles.
            if !reaches(low[axis]) && !reaches(high[axis]) {
                continue;
            }
            let triangles = surface_triangles(&solid.form);
            let fills = |at: f64| overlaps_side(solid, &triangles, &BoxSide { axis, at, low, high });
            let crosses =
                [low[axis], high[axis]].map(|side| reaches(side) && fills(side - slack) && fills(side + slack));
            if crosses[0] == crosses[1] {
                continue;
            }
            let side = if crosses[0] { low[axis] } else { high[axis] };
            let message = format!(
                "solid \"{}\" crosses the side {} = {side} m of the lattice wind, which is joined to the opposite side: \
                 the part beyond would be missing there",
                solid.name,
                ["x", "y", "z"][axis]
            );
            let help = "move the solid into the box, enlarge the box with wind.lattice.cells, let the solid cross both \
                        sides, or set wind.lattice.sides = \"open\"";
            return Err(Diagnostic::about("S039", message).help(help).into());
        }
    }
    Ok(())
}

/// A rectangle that is a side of the box.
struct BoxSide {
    /// Axis normal to it, and its position along that axis, m.
    axis: usize,
    at: f64,
    /// Corners of the box, m.
    low: DVec3,
    high: DVec3,
}

/// Whether a solid with these triangles contains part of a side: a triangle cuts the side, or the whole side lies
/// inside the solid.
fn overlaps_side(solid: &Solid, triangles: &[[Vec3; 3]], side: &BoxSide) -> bool {
    let mut middle = (side.low + side.high) / 2.0;
    middle[side.axis] = side.at;
    triangles.iter().any(|triangle| cuts_side(triangle.map(|p| p.as_dvec3()), side)) || solid.contains(middle.as_vec3())
}

/// Whether a triangle cuts a side; a triangle that only touches the side's edges does not.
fn cuts_side(corners: [DVec3; 3], side: &BoxSide) -> bool {
    let axis = side.axis;
    let on_plane = |i: usize| {
        let (a, b) = (corners[i], corners[(i + 1) % 3]);
        let (before, after) = (a[axis] - side.at, b[axis] - side.at);
        ((before > 0.0) != (after > 0.0)).then(|| a + (b - a) * (before / (before - after)))
    };
    let mut ends = (0..3).filter_map(on_plane);
    let (Some(p), Some(q)) = (ends.next(), ends.next()) else { return false };
    // Clip the line of intersection to the edges of the side, by the signed distances of both ends from each edge, positive
    // outwards.
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    for along in [(axis + 1) % 3, (axis + 2) % 3] {
        let (low, high) = (side.low[along], side.high[along]);
        for (start, end) in [(low - p[along], low - q[along]), (p[along] - high, q[along] - high)] {
            if start >= 0.0 && end >= 0.0 {
                return false;
            }
            if start > 0.0 {
                enter = enter.max(start / (start - end));
            } else if end > 0.0 {
                leave = leave.min(start / (start - end));
            }
        }
    }
    enter < leave
}

/// Triangles of the surface of a prism or a mesh; empty for a land, which has no border.
fn surface_triangles(form: &Form) -> Vec<[Vec3; 3]> {
    match form {
        Form::Shell(shell) => shell.triangles().to_vec(),
        Form::Prism(prism) => {
            let [near, far] = prism.ends();
            // A fan about the first corner: the outlines of prisms are convex.
            let fan = |outline: &[Vec3]| -> Vec<[Vec3; 3]> {
                outline.windows(2).skip(1).map(|k| [outline[0], k[0], k[1]]).collect()
            };
            let sides = (0..near.len()).flat_map(|i| {
                let k = (i + 1) % near.len();
                fan(&[near[i], near[k], far[k], far[i]])
            });
            sides.chain(fan(&near)).chain(fan(&far)).collect()
        }
        Form::Land(_) => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use osier_scene::solid::{Prism, Shell};

    /// A square of 4 m across z at z = 1, with its lower edge at the origin.
    const SIDE: BoxSide =
        BoxSide { axis: 2, at: 1.0, low: DVec3::new(-2.0, 0.0, -9.0), high: DVec3::new(2.0, 4.0, 9.0) };

    /// Whether a block turned about +Y fills part of [`SIDE`], as a prism and as a mesh.
    fn fills(foot: Vec3, size: Vec3, turn: f32) -> bool {
        let prism = Form::Prism(Prism::block(foot, size, turn));
        let points: Vec<Vec3> = surface_triangles(&prism).into_iter().flatten().collect();
        let triangles: Vec<[u32; 3]> = (0..12).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let mesh = Form::Shell(Arc::new(Shell::new(&points, &triangles).expect("a block")));
        let [prism, mesh] = [prism, mesh].map(|form| {
            let triangles = surface_triangles(&form);
            overlaps_side(&Solid { name: "block".into(), form, humidity: 0.5 }, &triangles, &SIDE)
        });
        assert_eq!(prism, mesh);
        prism
    }

    #[test]
    fn blocks_fill_a_side_where_their_surface_cuts_it_or_encloses_it() {
        let wall = Vec3::new(6.0, 3.0, 0.4);
        // Turned by 45 degrees it cuts the side, passes beside it, or ends before it.
        for (foot, filled) in [
            (Vec3::new(0.0, 0.0, 1.0), true),
            (Vec3::new(1.9, 0.0, 1.0), true),
            (Vec3::new(2.5, 0.0, 1.0), false),
            (Vec3::new(4.0, 0.0, 1.0), false),
            (Vec3::new(0.0, 0.0, 5.0), false),
            (Vec3::new(0.0, -3.0, 1.0), false),
        ] {
            assert_eq!(fills(foot, wall, std::f32::consts::FRAC_PI_4), filled, "{foot}");
        }
        // A block of 20 m encloses the side; none of its faces cuts it.
        assert!(fills(Vec3::new(0.0, -5.0, 0.0), Vec3::splat(20.0), 0.3));
        // A block whose face lies in the plane of the side ends there.
        assert!(!fills(Vec3::ZERO, Vec3::new(1.0, 1.0, 2.0), 0.0));
    }
}
