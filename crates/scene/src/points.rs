//! Point clouds and curves.

use glam::Vec3;

use super::{Attribute, MaterialId};
use osier_base::geometry::Bounds;

/// A point cloud of fixed capacity; a width of 0 hides a point.
#[derive(Debug, Clone)]
pub struct Points {
    /// Prim and node name, `[a-z0-9_]+`, unique in the asset.
    pub name: String,
    /// Material of all points.
    pub material: MaterialId,
    /// Positions at rest in asset space, m.
    pub positions: Vec<Vec3>,
    /// Diameters, m, one per point.
    pub widths: Vec<f32>,
    /// Linear RGB, one per point, or empty.
    pub colors: Vec<[f32; 3]>,
    /// Further values, one per point; constant over the clip.
    pub attributes: Vec<Attribute>,
    /// True if frames carry positions and widths.
    pub moving: bool,
    /// Box in asset space that its points never leave, m; empty if it is not known.
    pub reach: Bounds,
}

/// What a frame changes of one point cloud.
#[derive(Debug, Clone, Default)]
pub enum PointsFrame {
    /// The points as in the scene.
    #[default]
    Same,
    /// New positions and widths.
    State {
        /// Positions in asset space, m, one per point.
        positions: Vec<Vec3>,
        /// Diameters, m; 0 hides.
        widths: Vec<f32>,
        /// Velocities in asset space, m/s, one per point; empty where they are not known.
        velocities: Vec<Vec3>,
        /// Linear RGB, one per point, or empty: as at rest.
        colors: Vec<[f32; 3]>,
    },
}

/// State of a cloud at one time; the lists are borrowed from the scene or from a frame.
#[derive(Debug, Clone, Copy)]
pub struct PointsNow<'a> {
    /// Positions in asset space, m.
    pub positions: &'a [Vec3],
    /// Diameters, m; 0 hides.
    pub widths: &'a [f32],
    /// Velocities in asset space, m/s, one per point, or empty.
    pub velocities: &'a [Vec3],
    /// Linear RGB, one per point, or empty.
    pub colors: &'a [[f32; 3]],
}

impl Points {
    /// The cloud at a frame. One that the frame leaves as it is has no velocities.
    pub fn at<'a>(&'a self, frame: &'a PointsFrame) -> PointsNow<'a> {
        let (positions, widths, colors) = (&self.positions[..], &self.widths[..], &self.colors[..]);
        match frame {
            PointsFrame::Same => PointsNow { positions, widths, velocities: &[], colors },
            PointsFrame::State { positions, widths, velocities, colors: own } => {
                let colors = if own.is_empty() { colors } else { own };
                PointsNow { positions, widths, velocities, colors }
            }
        }
    }
}

/// Polylines with a diameter at each point, such as hairs and the trails of flying things.
#[derive(Debug, Clone)]
pub struct Curves {
    /// Prim and node name, `[a-z0-9_]+`, unique in the asset.
    pub name: String,
    /// Material of all curves.
    pub material: MaterialId,
    /// Points per curve, each at least 2.
    pub counts: Vec<u32>,
    /// All points, m, curve after curve.
    pub points: Vec<Vec3>,
    /// Diameters, m, one per point.
    pub widths: Vec<f32>,
    /// True if frames carry points.
    pub moving: bool,
}

impl Curves {
    /// Copy with `points` in place of those at rest, without curves whose points all coincide, such as the trail of something
    /// that does not move.
    pub fn drawn(&self, points: &[Vec3]) -> Self {
        let mut out = Self { counts: Vec::new(), points: Vec::new(), widths: Vec::new(), ..self.clone() };
        let mut first = 0_usize;
        for count in &self.counts {
            let range = first..first + *count as usize;
            first = range.end;
            let Some((line, widths)) = points.get(range.clone()).zip(self.widths.get(range)) else { continue };
            if line.windows(2).any(|p| p[0] != p[1]) {
                out.counts.push(*count);
                out.points.extend_from_slice(line);
                out.widths.extend_from_slice(widths);
            }
        }
        out
    }

    /// Box of the curves at rest, grown by half of their widths.
    pub fn bounds(&self) -> Bounds {
        let one = |(p, w): (&Vec3, &f32)| Bounds::of([*p]).expanded(w * 0.5);
        self.points.iter().zip(&self.widths).map(one).fold(Bounds::default(), Bounds::union)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_no_length_is_not_drawn() {
        let curves = Curves {
            name: "trails".into(),
            material: 0,
            counts: vec![2, 3],
            points: vec![Vec3::ZERO; 5],
            widths: vec![0.0, 1.0, 2.0, 3.0, 4.0],
            moving: true,
        };
        let points = [Vec3::X, Vec3::X, Vec3::ZERO, Vec3::ZERO, Vec3::Y];
        let drawn = curves.drawn(&points);
        assert_eq!((drawn.counts, drawn.widths), (vec![3], vec![2.0, 3.0, 4.0]));
        assert_eq!(drawn.points, points[2..]);
    }
}
