//! Deposition maps: number or mass of deposited catkins per square metre, on the ground and on walls.

use glam::Vec3;

use crate::recipe::scene::{DepositQuantity, FlightKeys};
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_motion::flight::{Catkin, CatkinState, FlightSimulation};
use osier_scene::Field;
use osier_scene::solid::{Form, Side, Solids};

/// Maps of a flight: the ground first, then four sides of each straight solid.
#[derive(Debug, Clone)]
pub struct DepositionMaps {
    /// As the scene holds them.
    pub fields: Vec<Field>,
    /// For each solid, where its four maps begin.
    sides: Vec<Option<(usize, [Side; 4])>>,
    mass: bool,
    blur: f32,
}

impl DepositionMaps {
    /// Maps over the box `inside` and over `solids`.
    pub fn new(keys: &FlightKeys, inside: Bounds, solids: &Solids) -> Self {
        let mass = keys.map_of == DepositQuantity::Mass;
        let mut fields = Vec::new();
        let mut add = |name: String, (corner, along, down): (Vec3, Vec3, Vec3)| {
            let texels = |length: f32| texel_count(length, keys.map_texel);
            fields.push(Field {
                name,
                what: "deposition",
                width: texels(along.length()),
                height: texels(down.length()),
                corner,
                along,
                down,
                unit: if mass { "mg/m^2" } else { "1/m^2" },
                every: keys.map_every,
            });
        };
        let size = inside.size();
        add("ground".into(), (Vec3::new(inside.min.x, 0.0, inside.min.z), Vec3::X * size.x, Vec3::Z * size.z));
        let mut sides = Vec::new();
        let mut next = 1;
        for solid in solids.list() {
            let Form::Prism(prism) = &solid.form else {
                sides.push(None);
                continue;
            };
            let four = prism.sides();
            for (side, name) in four.iter().zip(["front", "back", "right", "left"]) {
                add(format!("wall_{}_{name}", solid.name), (side.corner, side.along, side.down));
            }
            sides.push(Some((next, four)));
            next += 4;
        }
        Self { fields, sides, mass, blur: narrow(keys.map_blur) }
    }

    /// Area densities of all maps, row by row: 1/m^2, or mg/m^2. The sum of density times texel area over a map is the number or
    /// mass that lies on its surface.
    pub fn densities(&self, flights: &FlightSimulation) -> Vec<Vec<f32>> {
        let mut sums: Vec<Vec<f64>> = self.fields.iter().map(|f| vec![0.0; f.width * f.height]).collect();
        for c in flights.by_id().filter(|c| c.state().is_deposited()) {
            let map = self.map_index(c);
            if let (Some(field), Some(sum)) = (self.fields.get(map), sums.get_mut(map)) {
                let weight = if self.mass { c.mass() * 1e6 } else { 1.0 };
                self.splat(field, sum, c.position().as_vec3(), weight);
            }
        }
        let areas = self.fields.iter().map(Field::texel_area);
        sums.into_iter().zip(areas).map(|(sum, area)| sum.into_iter().map(|v| narrow(v / area)).collect()).collect()
    }

    /// Index of the map that counts a catkin: on a wall, that of the side whose normal is nearest to the contact normal; else the
    /// ground's.
    fn map_index(&self, c: &Catkin) -> usize {
        let (face, normal) = c.rests_on();
        let side = face.filter(|_| c.state() == CatkinState::OnWall).and_then(|i| self.sides.get(i as usize)?.as_ref());
        side.map_or(0, |(first, four)| {
            let facing = |k: &usize| four[*k].normal.dot(normal);
            first + (0..4).max_by(|a, b| facing(a).total_cmp(&facing(b))).unwrap_or(0)
        })
    }

    /// Spreads a weight evenly over the texels whose centres lie within `blur` m of a world position, so that the total is kept.
    fn splat(&self, field: &Field, sum: &mut [f64], position: Vec3, weight: f64) {
        // Texel coordinates: the components along the map's edges as shares of their lengths, times the texel counts.
        let from = position - field.corner;
        let share = |axis: Vec3| from.dot(axis) / axis.length_squared();
        let (x, y) = (share(field.along) * field.width as f32, share(field.down) * field.height as f32);
        // The blur's radius in texels along each edge; the disc is an ellipse where texels are not square.
        let texel_size = [field.along.length() / field.width as f32, field.down.length() / field.height as f32];
        let [rx, ry] = texel_size.map(|texel| self.blur / texel);
        let (xs, ys) = (texel_range(x, rx, field.width), texel_range(y, ry, field.height));
        let inside = |i: usize, k: usize| {
            let (dx, dy) = (i as f32 + 0.5 - x, k as f32 + 0.5 - y);
            let offset = glam::Vec2::new(dx / rx.max(0.5), dy / ry.max(0.5));
            self.blur <= 0.0 || offset.length_squared() <= 1.0
        };
        let texels: Vec<usize> = ys
            .clone()
            .flat_map(|k| xs.clone().filter(move |i| inside(*i, k)).map(move |i| k * field.width + i))
            .collect();
        // A disc smaller than a texel may hold no centre: then the texel below it takes all.
        let nearest = nearest_texel(y, field.height) * field.width + nearest_texel(x, field.width);
        let texels = if texels.is_empty() { vec![nearest] } else { texels };
        let share = weight / texels.len() as f64;
        texels.iter().for_each(|t| sum[*t] += share);
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the map")]
fn nearest_texel(v: f32, count: usize) -> usize {
    (v.max(0.0) as usize).min(count - 1)
}

/// Texels that a disc of `radius` texels around `v` may touch, clamped to the map.
fn texel_range(v: f32, radius: f32, count: usize) -> std::ops::RangeInclusive<usize> {
    nearest_texel(v - radius, count)..=nearest_texel(v + radius, count)
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 1..16384")]
fn texel_count(length: f32, texel: f64) -> usize {
    (f64::from(length) / texel).ceil().clamp(1.0, 16_384.0) as usize
}
