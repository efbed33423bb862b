//! Framing: cameras fitted to the visible part of a scene.

use glam::Vec3;

use osier_base::geometry::Bounds;
use osier_base::math::{self, narrow};
use osier_base::units::radians_f32;
use osier_scene::{AssetFrame, AssetKind, Camera, Frame, Prototype, Scene, instance_states, mesh_points};

/// Sample points of a scene's shape, at most about this many: fitting visits all of them a dozen times.
const MAX_POINTS: usize = 60_000;
/// Fraction of the half width and half height of the picture that the subject fills; the rest is margin.
const FILL: f32 = 0.90;
/// Least height of the camera of [`CameraView::Portrait`] over the lowest point of its subject, as a share of the subject's height.
/// Lower: grass and the relief of the ground hide the foot of a tree. Higher: wide trees lose the low horizon.
const LEAST_EYE_HEIGHT: f32 = 0.12;

/// Direction from which a fitted camera looks at its subject.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CameraView {
    /// 28 degrees to the right of the front and slightly from below, so that the horizon lies low; flat subjects are
    /// seen from above.
    Portrait,
    /// The direction of two angles.
    Angles {
        /// Azimuth from +Z towards +X, degrees.
        azimuth: f32,
        /// Elevation above the horizon, degrees, -89.9 to 89.9.
        elevation: f32,
    },
}

impl CameraView {
    /// Azimuth and elevation of the camera as seen from the subject, degrees. `bounds`: of the subject.
    fn angles(self, bounds: Bounds) -> [f32; 2] {
        match self {
            Self::Angles { azimuth, elevation } => [azimuth, elevation],
            Self::Portrait => {
                let size = bounds.size();
                // 0 for subjects at least half as high as wide, 1 for a flat one.
                let flatness = 1.0 - (size.y / (size.x.max(size.z) * 0.5).max(1e-9)).min(1.0);
                [28.0, -6.0 + 44.0 * flatness]
            }
        }
    }
}

/// Unit vector from the subject to a camera at two angles, degrees.
fn direction_to_camera([azimuth, elevation]: [f32; 2]) -> Vec3 {
    // The elevation stays just below 90 degrees, where the camera would have no upward direction; in a view from above at
    // azimuth 0, -Z is at the top of the picture.
    let (a, e) = (radians_f32(azimuth), radians_f32(elevation.clamp(-89.9, 89.9)));
    Vec3::new(math::cos_f32(e) * math::sin_f32(a), math::sin_f32(e), math::cos_f32(e) * math::cos_f32(a))
}

/// The part of a scene that a camera frames: sample points in the world of everything but the ground.
#[derive(Debug, Clone, Default)]
pub struct Subject {
    points: Vec<Vec3>,
    /// Box in the world around all points, including those that were thinned out, m; empty without points.
    pub bounds: Bounds,
    /// Whether the scene has ground or terrain, which is not part of the points.
    pub ground: bool,
}

impl Subject {
    /// The subject of a scene at a frame; `None`: at rest. If the scene consists only of terrain, the terrain is the subject.
    pub fn of(scene: &Scene, frame: Option<&Frame>) -> Self {
        let is_terrain =
            |p: &&osier_scene::Placement| scene.assets.get(p.asset).is_some_and(|a| a.kind == AssetKind::Terrain);
        let ground = scene.placements.iter().any(|p| is_terrain(&p));
        let alone = scene.placements.iter().all(|p| is_terrain(&p));
        let (mut points, mut reach) = (Vec::new(), Vec::new());
        for p in scene.placements.iter().filter(|p| alone || !is_terrain(p)) {
            let (Some(asset), rest) = (scene.assets.get(p.asset), AssetFrame::default()) else { continue };
            let state = frame.and_then(|f| f.shown(p)).unwrap_or(&rest);
            let mut own = Vec::new();
            for (i, m) in asset.meshes.iter().enumerate() {
                own.extend_from_slice(&mesh_points(asset, m, i, state));
            }
            for (i, instancer) in asset.instancers.iter().enumerate() {
                let now = instance_states(asset, instancer, i, state);
                let boxes: Vec<Bounds> = instancer.prototypes.iter().map(Prototype::bounds).collect();
                for k in (0..instancer.len()).filter(|k| now.is_alive(*k)) {
                    let b = boxes.get(instancer.protos[k] as usize).copied().unwrap_or_default();
                    if !b.is_empty() {
                        let trs = instancer.transform(&now, k);
                        if asset.kind == AssetKind::Tracks {
                            own.extend(b.corners().map(|c| trs.apply(c)));
                        } else {
                            // Two corners of each leaf are enough for the outline of a crown.
                            own.extend([trs.apply(b.min), trs.apply(b.max)]);
                        }
                    }
                }
            }
            for (i, cloud) in asset.points.iter().enumerate() {
                // Rain starts far upwind of the plants; only the box in which it falls on them is
                // framed.
                if asset.kind != AssetKind::Tracks || cloud.reach.is_empty() {
                    own.extend_from_slice(cloud.at(state.points(i)).positions);
                }
                // Moving points are framed by the box of all frames, so that the camera is the same
                // for each.
                let corners = cloud.reach.corners().into_iter().filter(|_| !cloud.reach.is_empty());
                reach.extend(corners.map(|x| p.transform.apply(x)));
            }
            own.extend(asset.curves.iter().flat_map(|c| c.points.iter().copied()));
            points.extend(own.into_iter().map(|x| p.transform.apply(x)));
        }
        // Every nth point is kept: neighbours in a mesh lie close together, so none of the outline
        // is lost but by that distance.
        let bounds = Bounds::of(points.iter().chain(&reach).copied());
        let step = points.len().div_ceil(MAX_POINTS).max(1);
        Self { points: points.into_iter().step_by(step).chain(reach).collect(), bounds, ground }
    }

    /// The union of two subjects, so that a camera shows both; it has ground if one of them has.
    #[must_use]
    pub fn with(mut self, other: &Self) -> Self {
        self.points.extend_from_slice(&other.points);
        Self { bounds: self.bounds.union(other.bounds), ground: self.ground || other.ground, points: self.points }
    }

    /// The volume that the subject sweeps when it turns about the vertical axis through its centre.
    #[must_use]
    pub fn spun(&self) -> Self {
        /// Rotations that sample the swept volume: 30 degrees apart, so that no point is missed by more than 3.4 % of
        /// its radius.
        const ROTATIONS: u8 = 12;
        let axis = self.bounds.center();
        let step = (self.points.len() * usize::from(ROTATIONS)).div_ceil(MAX_POINTS).max(1);
        let rotations = (0..ROTATIONS)
            .map(|i| glam::Quat::from_rotation_y(std::f32::consts::TAU * f32::from(i) / f32::from(ROTATIONS)));
        let rotated = |q: glam::Quat| self.points.iter().step_by(step).map(move |p| axis + q * (*p - axis));
        Self { points: rotations.flat_map(rotated).collect(), ..self.clone() }
    }

    /// Whether the scene has no point that a camera could frame.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// A camera that shows the whole subject as large as possible. `aspect`: width over height; `vfov`: vertical
    /// field of view, rad. The camera of [`CameraView::Portrait`] looks up from below only as far as it stays above the subject's foot.
    pub fn camera(&self, view: CameraView, aspect: f32, vfov: f32) -> Camera {
        let [azimuth, elevation] = view.angles(self.bounds);
        let mut camera = self.fitted(direction_to_camera([azimuth, elevation]), aspect, vfov);
        if view != CameraView::Portrait {
            return camera;
        }
        let least = self.bounds.min.y + LEAST_EYE_HEIGHT * self.bounds.size().y;
        // A narrow picture of a wide subject is taken from far away, where a view from below starts under the ground. Another elevation
        // changes the distance a little, so that the second round meets the height within a percent.
        for _ in 0..2 {
            if camera.eye.y >= least {
                break;
            }
            let rise = least - camera.target.y;
            let level = (camera.eye.distance_squared(camera.target) - rise * rise).max(0.0).sqrt();
            let raised = math::atan2(rise.into(), level.into()).to_degrees();
            camera = self.fitted(direction_to_camera([azimuth, narrow(raised)]), aspect, vfov);
        }
        camera
    }

    /// A camera in the direction `to_camera` from the subject, as near as the whole subject allows.
    /// Own: for a fixed direction each point needs a distance, and the largest of them is taken; the target is then
    /// moved until opposite margins are equal.
    fn fitted(&self, to_camera: Vec3, aspect: f32, vfov: f32) -> Camera {
        let mut camera =
            Camera { eye: self.bounds.center() + to_camera, target: self.bounds.center(), vfov, roll: 0.0 };
        let [right, up, back] = camera.axes();
        // The margin is a smaller field of view that the subject has to fit into.
        let tan = math::tan_f32(vfov * 0.5) * FILL;
        let mut target = self.bounds.center();
        let mut distance = self.bounds.size().length().max(1e-3);
        // Alternating the two converges within a few steps; it stops at a shift of 1e-4 of the
        // distance.
        for _ in 0..12 {
            // A point off the axis by x at depth z is inside if |x| <= z tan: it needs the distance
            // |x| / tan plus its height above the target towards the camera.
            let distances = self.points.iter().map(|p| {
                let w = *p - target;
                let wide = (w.dot(right).abs() / (tan * aspect)).max(w.dot(up).abs() / tan);
                wide + w.dot(back)
            });
            distance = distances.fold(1e-3, f32::max);
            // Centre of the projected extent along an axis, converted back to metres at the depth of the target.
            let projected =
                |axis: Vec3, p: Vec3| (p - target).dot(axis) / (distance - (p - target).dot(back)).max(1e-6);
            let center = |axis: Vec3| {
                let span = self.points.iter().map(|p| projected(axis, *p));
                let (lo, hi) = span.fold((f32::MAX, f32::MIN), |(lo, hi), v| (lo.min(v), hi.max(v)));
                if lo <= hi { (lo + hi) * 0.5 * distance } else { 0.0 }
            };
            let shift = right * center(right) + up * center(up);
            target += shift;
            // Moving the target along the picture plane changes the distances again, by less each
            // time.
            if shift.length() < 1e-4 * distance {
                break;
            }
        }
        camera.target = target;
        camera.eye = target + to_camera * distance;
        camera
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn subject(points: Vec<Vec3>) -> Subject {
        Subject { bounds: Bounds::of(points.iter().copied()), points, ground: false }
    }

    #[test]
    fn everything_is_in_the_picture_and_touches_the_margin() {
        let points: Vec<Vec3> =
            (0..200).map(|i| Vec3::new((i % 7) as f32, (i % 13) as f32 * 0.7, (i % 5) as f32)).collect();
        for view in [
            CameraView::Portrait,
            CameraView::Angles { azimuth: 200.0, elevation: 50.0 },
            CameraView::Angles { azimuth: 0.0, elevation: 90.0 },
        ] {
            let s = subject(points.clone());
            let camera = s.camera(view, 1.5, 0.6);
            let [right, up, back] = camera.axes();
            let tan = math::tan_f32(0.3);
            let worst = points.iter().map(|p| {
                let w = *p - camera.eye;
                let z = -w.dot(back);
                (w.dot(right).abs() / (z * tan * 1.5)).max(w.dot(up).abs() / (z * tan))
            });
            let worst = worst.fold(0.0, f32::max);
            assert!((0.85..=0.91).contains(&worst), "{view:?} fills {worst}");
        }
    }

    #[test]
    fn narrow_pictures_of_wide_trees_are_taken_from_above_the_ground() {
        // A crown twice as wide as high: from -6 degrees a narrow picture is taken from under the ground.
        let crown = (0..64).map(|i| {
            let a = i as f32 * 0.1;
            Vec3::new(5.0 * math::cos_f32(a), 1.0 + 4.0 * (i % 5) as f32 / 4.0, 5.0 * math::sin_f32(a))
        });
        let s = subject(crown.chain([Vec3::ZERO]).collect());
        let eye = |aspect: f32| s.camera(CameraView::Portrait, aspect, 0.7).eye;
        let below = s.fitted(direction_to_camera([28.0, -6.0]), 0.5, 0.7).eye;
        assert!(below.y < 0.0, "{below}");
        assert!((eye(0.5).y - 0.6).abs() < 0.05, "{}", eye(0.5));
        // A wide picture needs no change.
        assert_eq!(eye(2.0), s.fitted(direction_to_camera([28.0, -6.0]), 2.0, 0.7).eye);
    }

    #[test]
    fn one_point_has_a_camera() {
        let camera = subject(vec![Vec3::ONE]).camera(CameraView::Portrait, 1.0, 0.6);
        assert!(camera.eye.is_finite() && camera.eye != camera.target);
    }
}
