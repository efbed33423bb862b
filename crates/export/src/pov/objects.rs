//! Instances as transformed objects, points as spheres and streaks, curves as cones and spheres.

use glam::Vec3;

use super::space::{PovSpace, round_to, write_rgb};
use crate::text::TextBuffer;
use osier_scene::{Curves, InstanceState, Instancer, Material, MaterialClass, Points, PointsNow};

/// Most spheres of a point cloud. Own: POV-Ray parses them again for every frame; a larger limit shows more of a dense cloud.
pub(super) const MAX_SPHERES: usize = 100_000;

/// Opacity of a streak as long as it is wide, 0 to 1; a longer streak has proportionally less. Own: chosen by eye.
const STREAK_OPACITY: f32 = 0.14;

/// Least ratio of a streak's length to the drop's width; a slower drop is drawn as a sphere. Own: chosen by eye.
const MIN_STREAK_ASPECT: f32 = 3.0;

/// Number of steps per radius of a drop to which the coordinates of its streak are rounded; the step is the power of
/// ten at or below radius / this. Own: eight steps per radius are finer than a pixel of any visible streak.
const STREAK_POSITION_STEPS: f32 = 8.0;

/// The macro of a streak of falling water: position, half of its displacement, radius in the middle, and transparency.
/// Two cones taper from the middle to the ends, where the drop is for the shortest time. The interior of refractive
/// index 1 prevents the refraction that the interior of water would cause.
pub(super) const STREAK_MACRO: &str = "#macro OsStreak(P, H, R, T) union{cone{P-H,0,P,R open}cone{P+H,0,P,R open} \
    texture{pigment{rgbt<1,1,1,T>}finish{diffuse 0.25,0.25}}interior{ior 1}no_shadow} #end\n";

/// The largest power of ten that is not above `x` > 0.
fn decimal_step(x: f32) -> f32 {
    let mut step = 1.0;
    while step > x && step > 1e-6 {
        step *= 0.1;
    }
    while step * 10.0 <= x && step < 1e6 {
        step *= 10.0;
    }
    step
}

/// Writes shapes as one object: POV-Ray warns of unions of one object and of none. `tail`: texture and interior of the object.
pub(super) fn write_union(text: &mut TextBuffer, count: usize, shapes: &TextBuffer, tail: &str) {
    match count {
        // An invisible sphere of radius 0 declares the identifier, so that every use of it is valid.
        0 => text.put("sphere{0,0 no_image no_shadow no_reflection}\n"),
        1 => text.put("object{\n").append(shapes).put(tail).put("}\n"),
        _ => text.put("union{\n").append(shapes).put(tail).put("}\n"),
    };
}

/// How instances refer to their prototype.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PrototypeUse {
    /// A prototype without geometry, which has no declaration.
    Nothing,
    /// An object declared with `#declare` in prototypes.inc.
    Object,
    /// A macro, since the texture of the mesh changes with the frame.
    Macro,
}

/// Writes a line for each live instance: `object{P_a_i_p matrix <..>}`. `name`: indices a and i of asset and instancer; `uses`:
/// one for each prototype. Returns the number of lines.
pub(super) fn write_instances(
    text: &mut TextBuffer,
    space: PovSpace,
    name: (usize, usize),
    instancer: &Instancer,
    state: &InstanceState,
    uses: &[PrototypeUse],
) -> usize {
    let used = |i: usize| {
        let prototype = instancer.protos.get(i).and_then(|p| uses.get(*p as usize));
        prototype.copied().unwrap_or(PrototypeUse::Nothing)
    };
    let visible = |i: &usize| state.is_alive(*i) && used(*i) != PrototypeUse::Nothing;
    let alive: Vec<usize> = (0..instancer.len()).filter(visible).collect();
    let start = format!("object{{P_{}_{}_", name.0, name.1);
    text.lines(&alive, |t, _, i| {
        t.put(&start).int(instancer.protos[*i]).put(if used(*i) == PrototypeUse::Macro { "() " } else { " " });
        space.write_matrix(t, &instancer.transform(state, *i));
        t.put("}\n");
    });
    alive.len()
}

/// A point cloud at a frame, with the view that determines its streaks.
pub(super) struct CloudFrame<'a> {
    pub now: PointsNow<'a>,
    pub view: StreakView,
}

/// Shutter and camera, from which the motion blur of falling drops follows.
#[derive(Debug, Clone, Copy)]
pub(super) struct StreakView {
    /// Time for which the shutter is open, s.
    pub open: f32,
    /// Position of the camera, m.
    pub eye: Vec3,
    /// Streaks nearer to the camera than this, m, are left out.
    pub near: f32,
}

impl StreakView {
    /// Half of the displacement of a drop while the shutter is open; `None` if it is too short for a
    /// streak ([`MIN_STREAK_ASPECT`]).
    fn half_streak(&self, velocity: Option<&Vec3>, radius: f32) -> Option<Vec3> {
        // half = v t / 2, so the streak is 2 |half| long and the drop 2 radius wide: the factors 2 cancel in the ratio.
        velocity.map(|v| *v * (self.open * 0.5)).filter(|half| half.length() > MIN_STREAK_ASPECT * radius)
    }

    /// Whether the streak from `p` - `half` to `p` + `half` passes nearer to the camera than `near`.
    fn is_too_near(&self, p: Vec3, half: Vec3) -> bool {
        // Parameter of the point of the line that is nearest to the camera, -1 to 1 on the streak.
        let t = (self.eye - p).dot(half) / half.length_squared().max(1e-12);
        (p + half * t.clamp(-1.0, 1.0)).distance(self.eye) < self.near
    }
}

/// Whether a cloud consists of water, whose moving points are drawn as streaks.
pub(super) fn is_water(points: &Points, materials: &[Material]) -> bool {
    materials.get(points.material as usize).is_some_and(|m| m.class == MaterialClass::Water)
}

/// Writes the visible points of a cloud: spheres, or streaks for falling water. Of more than [`MAX_SPHERES`] points, only every
/// n-th is written. Returns how many were left out.
/// Source: [yang-wu], section 5: a falling drop is drawn as a tapered streak of the shutter's length.
/// Differs: the drop is at each point of its streak for a part of the time only, so the streak is nearly transparent, tapered to
/// both ends and without refraction.
pub(super) fn write_points(
    text: &mut TextBuffer,
    space: PovSpace,
    points: &Points,
    materials: &[Material],
    at: &CloudFrame,
) -> usize {
    // Only falling water is drawn as streaks; other points stay spheres at any velocity.
    let water = is_water(points, materials);
    let width = |i: usize| at.now.widths.get(i).copied().unwrap_or(0.0);
    let half = |i: usize| at.view.half_streak(at.now.velocities.get(i).filter(|_| water), width(i) * 0.5);
    let seen = |i: &usize| width(*i) > 0.0 && !half(*i).is_some_and(|h| at.view.is_too_near(at.now.positions[*i], h));
    let visible: Vec<usize> = (0..at.now.positions.len()).filter(seen).collect();
    // The smallest n for which every n-th visible point stays within the limit.
    let stride = visible.len().div_ceil(MAX_SPHERES).max(1);
    let kept: Vec<usize> = visible.iter().copied().step_by(stride).collect();
    // Every stride-th visible point, so that the ones left out are spread evenly over the cloud.
    let mut shapes = TextBuffer::default();
    shapes.lines(&kept, |t, _, i| {
        let (p, radius) = (at.now.positions[*i], at.now.widths[*i] * 0.5);
        match half(*i) {
            Some(half) => {
                // Opacity is proportional to width over length: a longer streak spreads the same water over a larger area.
                let opacity = STREAK_OPACITY * radius / half.length();
                let rounding = decimal_step(radius * space.scale / STREAK_POSITION_STEPS);
                t.put("object{OsStreak(");
                space.write_rounded_point(t, p, rounding);
                t.put(",");
                space.write_rounded_point(t, half, rounding);
                t.put(",").num(round_to(radius * space.scale, rounding));
                t.put(",").num(round_to(1.0 - opacity, 1e-5)).put(")");
            }
            None => {
                t.put("sphere{");
                space.write_point(t, p);
                t.put(",");
                space.write_length(t, radius);
            }
        }
        if let Some(c) = at.now.colors.get(*i).filter(|_| !water) {
            t.put(" pigment{");
            write_rgb(t, *c);
            t.put("}finish{F_").int(points.material).put("}");
        }
        t.put("}\n");
    });
    write_union(text, kept.len(), &shapes, &flat_texture(points.material, water));
    visible.len() - kept.len()
}

/// Writes polylines as cones, with a sphere at each of their points.
pub(super) fn write_curves(
    text: &mut TextBuffer,
    space: PovSpace,
    curves: &Curves,
    points: &[Vec3],
    materials: &[Material],
) {
    let radius = |i: usize| curves.widths.get(i).copied().unwrap_or(0.0).max(0.0) * 0.5;
    // For each point whether a segment leads to it from the one before: false for the first point of a curve.
    let mut joins = vec![false; points.len()];
    let mut start = 0_usize;
    for count in &curves.counts {
        let end = start.saturating_add(*count as usize).min(points.len());
        joins.iter_mut().take(end).skip(start + 1).for_each(|j| *j = true);
        start = end;
    }
    text.put("union{\n");
    text.lines(points, |t, i, p| {
        let before = joins[i] && points[i - 1] != *p;
        let after = joins.get(i + 1) == Some(&true) && points[i + 1] != *p;
        // Omit a point whose segments have length 0: POV-Ray rejects cones of length 0.
        if radius(i) > 0.0 && (before || after) {
            t.put("sphere{");
            space.write_point(t, *p);
            t.put(",");
            space.write_length(t, radius(i));
            t.put("}\n");
        }
        // A cone for the segment from the point before; the spheres at its ends close the gaps at bends.
        if before && radius(i) + radius(i - 1) > 0.0 {
            t.put("cone{");
            space.write_point(t, points[i - 1]);
            t.put(",");
            space.write_length(t, radius(i - 1));
            t.put(",");
            space.write_point(t, *p);
            t.put(",");
            space.write_length(t, radius(i));
            t.put("}\n");
        }
    });
    let water = materials.get(curves.material as usize).is_some_and(|m| m.class == MaterialClass::Water);
    text.put(&flat_texture(curves.material, water)).put("}\n");
}

/// Texture and interior of a material without its maps, as these shapes have no texture coordinates.
fn flat_texture(material: u32, water: bool) -> String {
    let interior = if water { format!("interior{{I_{material}}}") } else { String::new() };
    format!("texture{{C_{material}}}{interior}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_many_points_are_thinned_evenly_and_counted() {
        let n = 250_000;
        let points = Points {
            name: "p".into(),
            material: 0,
            positions: vec![Vec3::ONE; n],
            widths: vec![0.5; n],
            colors: Vec::new(),
            attributes: Vec::new(),
            moving: false,
            reach: osier_base::geometry::Bounds::default(),
        };
        let view = StreakView { open: 0.02, eye: Vec3::ZERO, near: 0.0 };
        let at = CloudFrame { now: points.at(&osier_scene::PointsFrame::Same), view };
        let mut text = TextBuffer::default();
        let dropped = write_points(&mut text, PovSpace { scale: 1.0 }, &points, &[], &at);
        let lines = text.bytes().split(|c| *c == b'\n').filter(|l| *l == b"sphere{<1,1,-1>,0.25}").count();
        assert_eq!((lines, dropped), (83_334, 166_666));
    }

    #[test]
    fn falling_water_is_a_veil_or_a_drop_and_none_hangs_before_the_eye() {
        let points = Points {
            name: "p".into(),
            material: 0,
            positions: [0.0, 1.0, 2.0].map(|x| Vec3::new(x, 0.0, 0.0)).to_vec(),
            widths: vec![0.002; 3],
            colors: Vec::new(),
            attributes: Vec::new(),
            moving: true,
            reach: osier_base::geometry::Bounds::default(),
        };
        let now = osier_scene::PointsFrame::State {
            positions: points.positions.clone(),
            widths: points.widths.clone(),
            velocities: vec![Vec3::NEG_Y * 6.0, Vec3::NEG_Y * 6.0, Vec3::NEG_Y * 0.05],
            colors: Vec::new(),
        };
        let water = Material::plain("water".into(), MaterialClass::Water, [1.0; 3], 0.0);
        // The first falls past the eye, below which it is now.
        let view = StreakView { open: 0.01, eye: Vec3::new(0.0, 0.025, 0.05), near: 0.1 };
        let mut text = TextBuffer::default();
        let lost = write_points(
            &mut text,
            PovSpace { scale: 100.0 },
            &points,
            &[water],
            &CloudFrame { now: points.at(&now), view },
        );
        let s = std::str::from_utf8(text.bytes()).expect("ascii");
        assert_eq!((lost, s.matches("OsStreak(").count(), s.matches("sphere{").count()), (0, 1, 1), "{s}");
        // Thirty times as long as wide, so that next to nothing of it is there at any one time.
        assert!(s.contains("object{OsStreak(<100,0,0>,<0,-3,0>,0.1,0.99533)}"), "{s}");
        assert!(s.contains("sphere{<200,0,0>,0.1}"), "{s}");
    }

    #[test]
    fn curves_do_not_join_each_other() {
        let hairs = Curves {
            name: "c".into(),
            material: 3,
            counts: vec![2, 2],
            points: [0.0, 1.0, 5.0, 6.0].map(|x| Vec3::new(x, 0.0, 0.0)).to_vec(),
            widths: vec![2.0; 4],
            moving: false,
        };
        let mut text = TextBuffer::default();
        write_curves(&mut text, PovSpace { scale: 1.0 }, &hairs, &hairs.points, &[]);
        let s = std::str::from_utf8(text.bytes()).expect("ascii");
        assert_eq!(s.matches("cone").count(), 2);
        assert!(s.contains("cone{<5,0,0>,1,<6,0,0>,1}") && !s.contains("cone{<1,0,0>"));
    }
}
