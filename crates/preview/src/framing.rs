//! Views that flatter without being told.

use glam::Vec3;

use osier_base::geometry::Bounds;
use osier_base::math;
use osier_base::units::radians_f32;
use osier_scene::{AssetFrame, AssetKind, Camera, Frame, Prototype, Scene, instance_states, mesh_points};

/// Points that stand for a scene's shape, at most about this many.
const POINTS: usize = 60_000;
/// PrimitiveRange of the picture's half width and height that the subject may fill.
const FILL: f32 = 0.90;

/// From which side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CameraView {
    /// A quarter turn off the front, from about a fifth of the subject's height: the horizon lies low.
    Portrait,
    /// Degrees: compass turn from +Z towards +X, and height over the horizon.
    Angles {
        /// From +Z towards +X, degrees.
        azimuth: f32,
        /// Over the horizon, degrees, -89 to 90.
        elevation: f32,
    },
}

impl CameraView {
    /// Unit vector from the subject to the camera. `bounds`: of the subject.
    fn out(self, bounds: Bounds) -> Vec3 {
        let (azimuth, elevation) = match self {
            Self::Angles { azimuth, elevation } => (azimuth, elevation),
            Self::Portrait => {
                let size = bounds.size();
                let flat = 1.0 - (size.y / (size.x.max(size.z) * 0.5).max(1e-9)).min(1.0);
                // From a fifth of the height one looks up a little; what lies flat is looked down upon.
                (28.0, -6.0 + 44.0 * flat)
            }
        };
        // Straight down, the picture's top is -Z.
        let (a, e) = (radians_f32(azimuth), radians_f32(elevation.clamp(-89.9, 89.9)));
        Vec3::new(math::cos_f32(e) * math::sin_f32(a), math::sin_f32(e), math::cos_f32(e) * math::cos_f32(a))
    }
}

/// What is in a picture: points of everything but the ground, in the world.
#[derive(Debug, Clone, Default)]
pub struct Subject {
    points: Vec<Vec3>,
    /// Their box.
    pub bounds: Bounds,
    /// True if there is ground.
    pub ground: bool,
}

impl Subject {
    /// Of a scene at a frame, `None` for rest. Ground alone is a subject, too.
    pub fn of(scene: &Scene, frame: Option<&Frame>) -> Self {
        let terrain =
            |p: &&osier_scene::Placement| scene.assets.get(p.asset).is_some_and(|a| a.kind == AssetKind::Terrain);
        let ground = scene.placements.iter().any(|p| terrain(&p));
        let alone = scene.placements.iter().all(|p| terrain(&p));
        let (mut points, mut reach) = (Vec::new(), Vec::new());
        for p in scene.placements.iter().filter(|p| alone || !terrain(p)) {
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
                            // Of many leaves two corners each tell where the crown ends.
                            own.extend([trs.apply(b.min), trs.apply(b.max)]);
                        }
                    }
                }
            }
            for (i, cloud) in asset.points.iter().enumerate() {
                // The wind brings rain from far away; only its fall on the plants is the subject.
                if asset.kind != AssetKind::Tracks || cloud.reach.is_empty() {
                    own.extend_from_slice(cloud.at(state.points(i)).positions);
                }
                // What moves is seen from the same place at every frame.
                let corners = cloud.reach.corners().into_iter().filter(|_| !cloud.reach.is_empty());
                reach.extend(corners.map(|x| p.transform.apply(x)));
            }
            own.extend(asset.curves.iter().flat_map(|c| c.points.iter().copied()));
            points.extend(own.into_iter().map(|x| p.transform.apply(x)));
        }
        let bounds = Bounds::of(points.iter().chain(&reach).copied());
        let step = points.len().div_ceil(POINTS).max(1);
        Self { points: points.into_iter().step_by(step).chain(reach).collect(), bounds, ground }
    }

    /// Both.
    #[must_use]
    pub fn with(mut self, other: &Self) -> Self {
        self.points.extend_from_slice(&other.points);
        Self { bounds: self.bounds.union(other.bounds), ground: self.ground || other.ground, points: self.points }
    }

    /// The subject as it sweeps through space when it turns about its upright axis.
    #[must_use]
    pub fn spun(&self) -> Self {
        const TURNS: u8 = 12;
        let axis = self.bounds.center();
        let step = (self.points.len() * usize::from(TURNS)).div_ceil(POINTS).max(1);
        let turns =
            (0..TURNS).map(|i| glam::Quat::from_rotation_y(std::f32::consts::TAU * f32::from(i) / f32::from(TURNS)));
        let turned = |q: glam::Quat| self.points.iter().step_by(step).map(move |p| axis + q * (*p - axis));
        Self { points: turns.flat_map(turned).collect(), ..self.clone() }
    }

    /// True if there is nothing to look at.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// A camera that has all of the subject in the picture, as large as it goes. `aspect`: width over height; `vfov`: rad.
    /// Own: with the direction fixed, each point asks for a distance; the middle is then moved until opposite margins
    /// are equal.
    pub fn camera(&self, view: CameraView, aspect: f32, vfov: f32) -> Camera {
        let out = view.out(self.bounds);
        let mut camera = Camera { eye: self.bounds.center() + out, target: self.bounds.center(), vfov, roll: 0.0 };
        let [right, up, back] = camera.axes();
        let tan = math::tan_f32(vfov * 0.5) * FILL;
        let mut middle = self.bounds.center();
        let mut distance = self.bounds.size().length().max(1e-3);
        for _ in 0..12 {
            let nearest = self.points.iter().map(|p| {
                let w = *p - middle;
                let wide = (w.dot(right).abs() / (tan * aspect)).max(w.dot(up).abs() / tan);
                wide + w.dot(back)
            });
            distance = nearest.fold(1e-3, f32::max);
            let shown = |axis: Vec3, p: Vec3| (p - middle).dot(axis) / (distance - (p - middle).dot(back)).max(1e-6);
            let mid = |axis: Vec3| {
                let span = self.points.iter().map(|p| shown(axis, *p));
                let (lo, hi) = span.fold((f32::MAX, f32::MIN), |(lo, hi), v| (lo.min(v), hi.max(v)));
                if lo <= hi { (lo + hi) * 0.5 * distance } else { 0.0 }
            };
            let shift = right * mid(right) + up * mid(up);
            middle += shift;
            if shift.length() < 1e-4 * distance {
                break;
            }
        }
        camera.target = middle;
        camera.eye = middle + out * distance;
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
    fn one_point_has_a_camera() {
        let camera = subject(vec![Vec3::ONE]).camera(CameraView::Portrait, 1.0, 0.6);
        assert!(camera.eye.is_finite() && camera.eye != camera.target);
    }
}
