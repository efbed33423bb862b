//! Instances, point clouds and curves.

use glam::Vec3;

use super::space::{Space, rgb};
use crate::text::Text;
use osier_scene::{Curves, InstanceState, Instancer, Material, MaterialClass, Points, PointsNow};

/// Most spheres that one cloud may have.
pub(super) const SPHERES: usize = 100_000;

/// How much of what is behind it a streak hides, where it is as long as it is wide. Own: chosen by eye, 0..1.
const VEIL: f32 = 0.14;

/// A drop that falls less far than so many times its width while the shutter is open is drawn as a ball: a streak would be as broad
/// as it is long.
const LONG: f32 = 3.0;

/// Shapes as one object. POV-Ray complains about a union of one, and of none. `tail`: what holds for all of them.
pub(super) fn group(text: &mut Text, count: usize, shapes: &Text, tail: &str) {
    match count {
        0 => text.put("sphere{0,0 no_image no_shadow no_reflection}\n"),
        1 => text.put("object{\n").append(shapes).put(tail).put("}\n"),
        _ => text.put("union{\n").append(shapes).put(tail).put("}\n"),
    };
}

/// One live instance per line, as `object { P_.. matrix <..> }`. `which`: indices of instances; `shown`: for each
/// prototype, whether it holds anything. Returns how many were written.
pub(super) fn instances(
    text: &mut Text,
    space: Space,
    name: (usize, usize),
    instancer: &Instancer,
    state: &InstanceState,
    shown: &[bool],
) -> usize {
    let visible = |i: &usize| {
        state.is_alive(*i) && instancer.protos.get(*i).and_then(|p| shown.get(*p as usize)).copied().unwrap_or(false)
    };
    let alive: Vec<usize> = (0..instancer.len()).filter(visible).collect();
    let start = format!("object{{P_{}_{}_", name.0, name.1);
    text.lines(&alive, |t, _, i| {
        t.put(&start).int(instancer.protos[*i]).put(" ");
        space.matrix(t, &instancer.transform(state, *i));
        t.put("}\n");
    });
    alive.len()
}

/// Points at one time.
pub(super) struct Cloud<'a> {
    /// Where they are.
    pub now: PointsNow<'a>,
    /// How what falls is seen.
    pub view: View,
}

/// How what falls is seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    /// Time for which the shutter is open, s.
    pub open: f32,
    /// Where the eye is, m.
    pub eye: Vec3,
    /// Streaks nearer to it are left out, m.
    pub near: f32,
}

impl View {
    /// Half of the way that a drop falls while the shutter is open, if that is [`LONG`] enough to be drawn as a streak.
    fn half(&self, velocity: Option<&Vec3>, radius: f32) -> Option<Vec3> {
        velocity.map(|v| *v * (self.open * 0.5)).filter(|half| half.length() > LONG * radius)
    }

    /// Whether a streak is so near that it would be drawn across the picture.
    fn blurs(&self, p: Vec3, half: Vec3) -> bool {
        let t = (self.eye - p).dot(half) / half.length_squared().max(1e-12);
        (p + half * t.clamp(-1.0, 1.0)).distance(self.eye) < self.near
    }
}

/// A cloud's visible points: spheres, or streaks for water that falls. At most [`SPHERES`], evenly chosen. Returns how
/// many were left out beyond that.
/// Source: [yang-wu], section 5: a falling drop is drawn as a tapered streak of the shutter's length.
/// Differs: the drop is at each place of its streak for a part of the time only, so the streak is a veil, tapered to both ends,
/// and not a rod of glass.
pub(super) fn cloud(text: &mut Text, space: Space, points: &Points, materials: &[Material], at: &Cloud) -> usize {
    let water = materials.get(points.material as usize).is_some_and(|m| m.class == MaterialClass::Water);
    let width = |i: usize| at.now.widths.get(i).copied().unwrap_or(0.0);
    let half = |i: usize| at.view.half(at.now.velocities.get(i).filter(|_| water), width(i) * 0.5);
    let seen = |i: &usize| width(*i) > 0.0 && !half(*i).is_some_and(|h| at.view.blurs(at.now.positions[*i], h));
    let visible: Vec<usize> = (0..at.now.positions.len()).filter(seen).collect();
    let stride = visible.len().div_ceil(SPHERES).max(1);
    let kept: Vec<usize> = visible.iter().copied().step_by(stride).collect();
    let mut shapes = Text::default();
    shapes.lines(&kept, |t, _, i| {
        let (p, radius) = (at.now.positions[*i], at.now.widths[*i] * 0.5);
        match half(*i) {
            Some(half) => {
                // Pointed at both ends: the drop is there for the shortest time.
                t.put("union{");
                for end in [p - half, p + half] {
                    t.put("cone{");
                    space.point(t, end);
                    t.put(",0,");
                    space.point(t, p);
                    t.put(",");
                    space.length(t, radius);
                    t.put(" open}");
                }
                // Its own interior, or it would bend what is seen through it.
                t.put(" texture{pigment{rgbt<1,1,1,").num(1.0 - VEIL * radius / half.length());
                t.put(">}finish{diffuse 0.25,0.25}}interior{ior 1}no_shadow");
            }
            None => {
                t.put("sphere{");
                space.point(t, p);
                t.put(",");
                space.length(t, radius);
            }
        }
        if let Some(c) = at.now.colors.get(*i).filter(|_| !water) {
            t.put(" pigment{");
            rgb(t, *c);
            t.put("}finish{F_").int(points.material).put("}");
        }
        t.put("}\n");
    });
    group(text, kept.len(), &shapes, &surface(points.material, water));
    visible.len() - kept.len()
}

/// Polylines as cones with a sphere at every point.
pub(super) fn curves(text: &mut Text, space: Space, curves: &Curves, points: &[Vec3], materials: &[Material]) {
    let radius = |i: usize| curves.widths.get(i).copied().unwrap_or(0.0).max(0.0) * 0.5;
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
        // What has no length shows nothing: the trail of something that does not move.
        if radius(i) > 0.0 && (before || after) {
            t.put("sphere{");
            space.point(t, *p);
            t.put(",");
            space.length(t, radius(i));
            t.put("}\n");
        }
        if before && radius(i) + radius(i - 1) > 0.0 {
            t.put("cone{");
            space.point(t, points[i - 1]);
            t.put(",");
            space.length(t, radius(i - 1));
            t.put(",");
            space.point(t, *p);
            t.put(",");
            space.length(t, radius(i));
            t.put("}\n");
        }
    });
    let water = materials.get(curves.material as usize).is_some_and(|m| m.class == MaterialClass::Water);
    text.put(&surface(curves.material, water)).put("}\n");
}

/// The flat colour of a material: these shapes have no texture coordinates.
fn surface(material: u32, water: bool) -> String {
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
        let view = View { open: 0.02, eye: Vec3::ZERO, near: 0.0 };
        let at = Cloud { now: points.at(&osier_scene::PointsFrame::Same), view };
        let mut text = Text::default();
        let dropped = cloud(&mut text, Space { scale: 1.0 }, &points, &[], &at);
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
        let view = View { open: 0.01, eye: Vec3::new(0.0, 0.025, 0.05), near: 0.1 };
        let mut text = Text::default();
        let lost = cloud(&mut text, Space { scale: 100.0 }, &points, &[water], &Cloud { now: points.at(&now), view });
        let s = std::str::from_utf8(text.bytes()).expect("ascii");
        assert_eq!((lost, s.matches("cone{").count(), s.matches("sphere{").count()), (0, 2, 1), "{s}");
        // Thirty times as long as wide, so that next to nothing of it is there at any one time.
        let streak = "union{cone{<100,3,0>,0,<100,0,0>,0.1 open}cone{<100,-3,0>,0,<100,0,0>,0.1 open} texture{pigment{rgbt<1,1,1,0.99";
        assert!(s.contains(streak), "{s}");
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
        let mut text = Text::default();
        curves(&mut text, Space { scale: 1.0 }, &hairs, &hairs.points, &[]);
        let s = std::str::from_utf8(text.bytes()).expect("ascii");
        assert_eq!(s.matches("cone").count(), 2);
        assert!(s.contains("cone{<5,0,0>,1,<6,0,0>,1}") && !s.contains("cone{<1,0,0>"));
    }
}
