//! Obstacles, which wind flows around and on which flying things come to rest.
//!
//! Each gives the distance of a point from its surface (negative inside) and the outward normal, exactly near the surface;
//! far from a height field the distance may be too small, never too large. Space: world, metres, +Y up.
//!
//! ```
//! use glam::Vec3;
//! use osier_scene::solid::{Form, Prism, Solid, Solids};
//!
//! let block = Prism::block(Vec3::ZERO, Vec3::ONE, 0.0);
//! let solids = Solids::new(vec![Solid { name: "block".into(), form: Form::Prism(block), humidity: 0.0 }], true);
//! assert!(solids.contains(Vec3::new(0.0, 0.5, 0.0)));
//! assert!(!solids.contains(Vec3::new(0.0, 1.5, 0.0)));
//! ```

mod land;
mod prism;
mod shell;

use std::sync::Arc;

use glam::Vec3;

use osier_base::geometry::Bounds;

pub use land::{CellDiagonal, LandForm, LandGrid};
pub use prism::{Prism, Side};
pub use shell::Shell;

/// Signed distance of a point from the surface of a solid, and the outward normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// Distance to the surface, m; negative inside. Far from a land it may be shorter than the true one.
    pub distance: f32,
    /// Unit vector out of the solid at the nearest point.
    pub normal: Vec3,
}

/// Shape of an obstacle.
#[derive(Debug, Clone)]
pub enum Form {
    /// A wall, a box or a house: a convex vertical outline extruded along a horizontal line.
    Prism(Prism),
    /// A height field over a rectangle of land.
    Land(Arc<LandForm>),
    /// A triangle mesh with its hierarchy of bounding boxes.
    Shell(Arc<Shell>),
}

/// An obstacle to wind and to flying things.
#[derive(Debug, Clone)]
pub struct Solid {
    /// Name in the scene file and in the file names of its maps.
    pub name: String,
    /// Its shape and place in the world.
    pub form: Form,
    /// Humidity of its faces, 0 to 1: what lies on them lifts off at once at 0, and never at 1.
    pub humidity: f64,
}

impl Solid {
    /// The axis-aligned box around it. For a height field, the box over its rectangle, although the land continues outside.
    #[inline]
    pub fn bounds(&self) -> Bounds {
        match &self.form {
            Form::Prism(p) => p.bounds(),
            Form::Land(l) => l.bounds(),
            Form::Shell(s) => s.bounds(),
        }
    }

    /// The axis-aligned box that holds all points inside the solid. For a height field it is unbounded except for its top.
    fn enclosing_box(&self) -> Bounds {
        let bounds = self.bounds();
        match &self.form {
            Form::Land(_) => Bounds { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY.with_y(bounds.max.y) },
            Form::Prism(_) | Form::Shell(_) => bounds,
        }
    }

    /// True for points inside; for a height field, true for all points below it.
    #[inline]
    pub fn contains(&self, at: Vec3) -> bool {
        match &self.form {
            Form::Prism(p) => p.nearest(at).distance < 0.0,
            Form::Land(l) => l.contains(at),
            Form::Shell(s) => s.contains(at),
        }
    }

    /// Signed distance of a point from the surface and the normal at the nearest point of it.
    #[inline]
    pub fn nearest(&self, at: Vec3) -> Nearest {
        match &self.form {
            Form::Prism(p) => p.nearest(at),
            Form::Land(l) => l.nearest(at),
            Form::Shell(s) => s.nearest(at),
        }
    }

    /// Whether a segment between two places outside passes through the solid. `slack`, m: a prism is grown by it on every
    /// side and a land is raised by it; the triangles of a mesh are grown by it in their planes, and an end within it of one
    /// meets the mesh.
    #[inline]
    pub fn meets(&self, segment: [Vec3; 2], slack: f32) -> bool {
        match &self.form {
            Form::Prism(p) => p.meets(segment, slack),
            Form::Land(l) => l.meets(segment, slack),
            Form::Shell(s) => s.meets(segment, slack),
        }
    }

    /// Conservative test of a box: false only if the surface does not pass through it.
    #[inline]
    pub fn may_touch(&self, within: Bounds) -> bool {
        match &self.form {
            Form::Prism(p) => p.nearest(within.center()).distance.abs() <= within.size().length() / 2.0,
            Form::Land(l) => l.may_touch(within),
            Form::Shell(s) => s.may_touch(within),
        }
    }

    /// Edges of a mesh that belong to an odd number of triangles: with any, the mesh is not closed. 0 for all other shapes.
    #[inline]
    pub fn open_edges(&self) -> usize {
        if let Form::Shell(s) = &self.form { s.open_edges() } else { 0 }
    }

    /// Text of the warning S032 for a mesh that is not closed; `None` for all other solids. `stopped`: the things that its
    /// surface stops although its inside is a guess, such as drops.
    pub fn open_mesh_warning(&self, stopped: &str) -> Option<String> {
        let edges = self.open_edges();
        (edges > 0).then(|| {
            format!(
                "the mesh of solid \"{}\" has {edges} open edges: its surface stops {stopped}, but its inside is a guess; close \
                 the mesh if it is to be solid",
                self.name
            )
        })
    }
}

/// All obstacles of a scene, with the ground at y = 0 where the scene has no hills.
#[derive(Debug, Clone, Default)]
pub struct Solids {
    all: Vec<Solid>,
    /// Parts that project from each solid; may be shorter than `all`.
    projections: Vec<Vec<Solid>>,
    /// One per solid: a box that holds all points inside the solid and inside the parts that project from it.
    boxes: Vec<Bounds>,
    /// True if everything below y = 0 is ground.
    level: bool,
}

/// A surface near a point, and the solid that it belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Near {
    /// Distance to it and the normal there.
    pub nearest: Nearest,
    /// Index in [`Solids::list`]; none for the level ground.
    pub which: Option<u32>,
}

impl Solids {
    /// `all`: in the scene's order; `level`: whether the level y = 0 is ground too.
    #[inline]
    pub fn new(all: Vec<Solid>, level: bool) -> Self {
        let boxes = all.iter().map(Solid::enclosing_box).collect();
        Self { all, projections: Vec::new(), boxes, level }
    }

    /// The same solids with parts that project from them, such as the eaves of roofs. A query treats a solid and its parts as one
    /// solid and returns the nearest of their surfaces with the index of the solid. `projections`: parallel to [`Solids::list`];
    /// solids beyond its end have none.
    #[inline]
    #[must_use]
    pub fn with_projections(mut self, projections: Vec<Vec<Solid>>) -> Self {
        for (bounds, parts) in self.boxes.iter_mut().zip(&projections) {
            *bounds = parts.iter().fold(*bounds, |bounds, part| bounds.union(part.enclosing_box()));
        }
        self.projections = projections;
        self
    }

    /// Parts that project from a solid of [`Solids::list`], by its index.
    #[inline]
    pub fn projections_of(&self, which: usize) -> &[Solid] {
        self.projections.get(which).map_or(&[], Vec::as_slice)
    }

    /// All solids in the scene's order; the level ground is not among them.
    #[inline]
    pub fn list(&self) -> &[Solid] {
        &self.all
    }

    /// The surface with the least signed distance among those within `reach`, m, of a point; if the point is inside a solid, the
    /// surface of that solid.
    #[inline]
    pub fn near(&self, at: Vec3, reach: f32) -> Option<Near> {
        let level = Near { nearest: Nearest { distance: at.y, normal: Vec3::Y }, which: None };
        let mut best = (self.level && at.y <= reach).then_some(level);
        self.each_near(at, reach, |near| {
            if best.is_none_or(|b| near.nearest.distance < b.nearest.distance) {
                best = Some(near);
            }
        });
        best
    }

    /// Every surface within `reach`, m, of a place: the ground first, then in the scene's order.
    #[inline]
    pub fn all_near(&self, at: Vec3, reach: f32) -> Vec<Near> {
        let level = Near { nearest: Nearest { distance: at.y, normal: Vec3::Y }, which: None };
        let mut found: Vec<Near> = if self.level && at.y <= reach { vec![level] } else { Vec::new() };
        self.each_near(at, reach, |near| found.push(near));
        found
    }

    /// Whether a segment between two places outside passes through a solid or comes within `slack`, m, of one.
    #[inline]
    pub fn meets(&self, segment: [Vec3; 2], slack: f32) -> bool {
        let (low, high) = (segment[0].min(segment[1]) - slack, segment[0].max(segment[1]) + slack);
        self.all.iter().zip(&self.boxes).enumerate().any(|(i, (solid, b))| {
            let is_met = |part: &Solid| part.meets(segment, slack);
            low.cmple(b.max).all()
                && high.cmpge(b.min).all()
                && (is_met(solid) || self.projections_of(i).iter().any(is_met))
        })
    }

    fn each_near(&self, at: Vec3, reach: f32, mut take: impl FnMut(Near)) {
        for ((k, (solid, b)), i) in self.all.iter().zip(&self.boxes).enumerate().zip(0..) {
            let away = (b.min - at).max(at - b.max).max(Vec3::ZERO);
            if away.length_squared() > reach * reach {
                continue;
            }
            let mut nearest = solid.nearest(at);
            for part in self.projections_of(k) {
                let near = part.nearest(at);
                if near.distance < nearest.distance {
                    nearest = near;
                }
            }
            if nearest.distance <= reach {
                take(Near { nearest, which: Some(i) });
            }
        }
    }

    /// True for points in the ground or in a solid.
    #[inline]
    pub fn contains(&self, at: Vec3) -> bool {
        let holds = |(i, (solid, b)): (usize, (&Solid, &Bounds))| {
            at.cmpge(b.min).all()
                && at.cmple(b.max).all()
                && (solid.contains(at) || self.projections_of(i).iter().any(|part| part.contains(at)))
        };
        (self.level && at.y < 0.0) || self.all.iter().zip(&self.boxes).enumerate().any(holds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wall() -> Solid {
        let prism = Prism::block(Vec3::new(0.0, 0.0, 0.0), Vec3::new(0.5, 4.0, 10.0), 0.0);
        Solid { name: "wall".into(), form: Form::Prism(prism), humidity: 0.5 }
    }

    #[test]
    fn the_nearer_of_ground_and_wall_answers() {
        let solids = Solids::new(vec![wall()], true);
        let near = solids.near(Vec3::new(0.45, 1.0, 0.0), 2.0).expect("a wall");
        assert_eq!(near.which, Some(0));
        assert!((near.nearest.distance - 0.2).abs() < 1e-6 && near.nearest.normal == Vec3::X);
        let near = solids.near(Vec3::new(3.0, 1.0, 0.0), 2.0).expect("ground");
        assert_eq!((near.which, near.nearest.normal), (None, Vec3::Y));
        assert!(solids.near(Vec3::new(3.0, 2.5, 0.0), 2.0).is_none());
        assert_eq!(solids.all_near(Vec3::new(0.45, 0.1, 0.0), 0.5).len(), 2);
        assert!(solids.contains(Vec3::new(0.0, 3.9, 0.0)) && !solids.contains(Vec3::new(0.0, 4.1, 0.0)));
    }

    #[test]
    fn eaves_are_one_with_their_house() {
        let house = Prism::house(Vec3::ZERO, Vec3::new(10.0, 5.0, 8.0), 3.0, 0.0);
        let eaves = house.roof_slabs(0.35, 0.16);
        let solid = |prism| Solid { name: "house".into(), form: Form::Prism(prism), humidity: 0.5 };
        let solids =
            Solids::new(vec![solid(house)], true).with_projections(vec![eaves.into_iter().map(solid).collect()]);
        assert!(solids.list().len() == 1 && solids.projections_of(0).len() == 2 && solids.projections_of(1).is_empty());
        // A slope of 3 in 4 from the ridge at 8 m over the wall at z = 4 to 0.35 m beyond it: above its middle, under it, in it.
        let over = Vec3::new(0.0, 5.0 - 0.6 * 0.2, 4.0 + 0.8 * 0.2);
        let (up, deep) = (Vec3::new(0.0, 0.8, 0.6), 0.08);
        for (at, distance, normal) in [(over + up * 0.1, 0.1, up), (over - up * 0.18, 0.02, -up)] {
            let near = solids.all_near(at, 0.5);
            assert!(near.len() == 1 && near[0].which == Some(0), "{near:?}");
            let Nearest { distance: found, normal: out } = near[0].nearest;
            assert!((found - distance).abs() < 1e-5 && out.distance(normal) < 1e-4, "{near:?}");
        }
        assert!(solids.contains(over - up * deep) && !solids.contains(over + up * deep));
        assert!(solids.meets([over + Vec3::Y, over - Vec3::Y], 0.0));
        // Beyond the gable at x = 5, 0.35 m long.
        assert!(solids.contains(Vec3::new(5.3, 7.9, 0.0)) && !solids.contains(Vec3::new(5.4, 7.9, 0.0)));
        // Below the eaves the wall answers, on the roof the roof of the house.
        let near = solids.near(Vec3::new(0.0, 2.0, 4.1), 1.0).expect("a wall").nearest;
        assert!((near.distance - 0.1).abs() < 1e-5 && near.normal.distance(Vec3::Z) < 1e-5, "{near:?}");
    }

    #[test]
    fn land_goes_on_downwards_and_beyond_its_rectangle() {
        // A ramp along x over 4 x 4 m, from 10 m at x = -2 to 12 m at x = 2.
        let heights = (0..25).map(|i| 10.0 + (i % 5) as f32 * 0.5).collect();
        let land = LandForm::new(5, 4.0, heights).expect("fits");
        let land = Solid { name: "land".into(), form: Form::Land(Arc::new(land)), humidity: 0.0 };
        let solids = Solids::new(vec![land], false);
        // Below its lowest height, and beside its rectangle, where the height is that of the edge.
        for (x, y) in [(0.0, 3.0), (0.0, 10.9), (9.0, 11.9), (9.0, -5.0), (-9.0, 9.9)] {
            assert!(solids.contains(Vec3::new(x, y, 0.3)), "{x} {y}");
            assert!(solids.near(Vec3::new(x, y, 0.3), 0.1).is_some_and(|near| near.nearest.distance < 0.0), "{x} {y}");
        }
        for (x, y) in [(0.0, 11.1), (9.0, 12.1), (-9.0, 10.1), (-9.0, 11.0)] {
            assert!(!solids.contains(Vec3::new(x, y, 0.3)), "{x} {y}");
        }
        // Beside the edge at x = 2 the land is level at 12 m, beyond the corner too; beside the edge at z = 2 it is the ramp.
        for z in [0.3, 7.0] {
            let near = solids.near(Vec3::new(9.0, 12.25, z), 1.0).expect("land below").nearest;
            assert!((near.distance - 0.25).abs() < 1e-5 && near.normal.distance(Vec3::Y) < 1e-4, "{near:?}");
        }
        let near = solids.near(Vec3::new(0.1, 11.3, 8.2), 1.0).expect("land below").nearest;
        let normal = Vec3::new(-0.5, 1.0, 0.0).normalize();
        assert!((near.distance - 0.25 * normal.y).abs() < 1e-5 && near.normal.distance(normal) < 1e-4, "{near:?}");
        assert!(solids.near(Vec3::new(9.0, 14.0, 0.0), 1.0).is_none());
    }
}
