//! Deposition maps: number or mass of deposited catkins per square metre, on the ground, on roofs and on walls.

use glam::Vec3;

use crate::recipe::scene::{DepositEvent, DepositQuantity, FlightKeys};
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_motion::flight::{CatkinState, RestingPlace};
use osier_scene::Field;
use osier_scene::solid::{Form, Prism, Side, Solid, Solids};

/// Maps of a flight: the ground first, then for each obstacle its roof and, if its walls are plane, its four sides.
#[derive(Debug, Clone)]
pub struct DepositionMaps {
    /// Declarations of the maps: position, resolution and unit.
    pub fields: Vec<Field>,
    /// Parallel to the solids; `None` for land, whose deposits lie on the ground's map.
    obstacles: Vec<Option<ObstacleMaps>>,
    mass: bool,
    blur: f32,
    /// Whether the maps count all depositions since the start instead of the catkins that rest at a frame.
    pub cumulative: bool,
}

/// Faces whose normal has a y below this are undersides, which slope by less than 60 degrees; the map from above counts their
/// deposits.
const UNDERSIDE_NORMAL_Y: f32 = -0.5;

/// Number or mass in each texel of all maps, row by row.
pub type TexelSums = Vec<Vec<f64>>;

/// Indices of the maps of an obstacle among the fields.
#[derive(Debug, Clone)]
struct ObstacleMaps {
    /// Index of the map of its roof, seen from above.
    roof: usize,
    /// The sides of a straight obstacle, whose maps follow that of the roof; `None` for a mesh, whose map from above also counts
    /// deposits on its walls.
    sides: Option<[Side; 4]>,
}

impl DepositionMaps {
    /// Empty maps of the ground within the box `inside`, and of `solids`; resolution, blur and quantity are from the keys.
    pub fn new(keys: &FlightKeys, inside: Bounds, solids: &Solids) -> Self {
        let mass = keys.map_of == DepositQuantity::Mass;
        let cumulative = keys.map_counts == DepositEvent::Landings;
        let mut fields = Vec::new();
        let mut add = |name: String, Side { corner, along, down, .. }: Side| {
            let texels = |length: f32| texel_count(length, keys.map_texel);
            fields.push(Field {
                name,
                what: if cumulative { "landings" } else { "deposition" },
                width: texels(along.length()),
                height: texels(down.length()),
                corner,
                along,
                down,
                unit: if mass { "mg/m^2" } else { "1/m^2" },
                every: keys.map_every,
            });
        };
        // The ground is field 0; for every obstacle its roof follows, then its walls, so that `roof` is the index of its first
        // field. Over land the box of the flight begins at its lowest point or at the base of a lattice; a level ground is at 0
        // in any box.
        let has_land = solids.list().iter().any(|solid| matches!(solid.form, Form::Land(_)));
        let height = if has_land { inside.min.y } else { 0.0 };
        add("ground".into(), top_face(Bounds { max: inside.max.with_y(height), ..inside }));
        let mut obstacles = Vec::new();
        let mut roof = 1;
        for (i, solid) in solids.list().iter().enumerate() {
            let (plan, sides) = match &solid.form {
                // Deposits on land count as ground; `None` keeps the list parallel to the solids.
                Form::Land(_) => {
                    obstacles.push(None);
                    continue;
                }
                Form::Prism(prism) => {
                    let roof: Vec<&Prism> = solids.projections_of(i).iter().filter_map(prism_of).collect();
                    (prism.plan(&roof), Some(prism.sides()))
                }
                // A mesh has no flat sides to map: its deposits are counted on the map from above.
                Form::Shell(_) => (top_face(solid.bounds()), None),
            };
            add(format!("roof_{}", solid.name), plan);
            for (side, name) in sides.iter().flatten().zip(["front", "back", "right", "left"]) {
                add(format!("wall_{}_{name}", solid.name), *side);
            }
            obstacles.push(Some(ObstacleMaps { roof, sides }));
            roof += 1 + sides.map_or(0, |sides| sides.len());
        }
        Self { fields, obstacles, mass, blur: narrow(keys.map_blur), cumulative }
    }

    /// A sum of 0 for each texel of every map.
    pub fn empty_sums(&self) -> TexelSums {
        self.fields.iter().map(|f| vec![0.0; f.width * f.height]).collect()
    }

    /// Adds catkins at rest to the map of the surface that carries each.
    pub fn add(&self, sums: &mut TexelSums, places: impl IntoIterator<Item = RestingPlace>) {
        for place in places {
            let map = self.map_index(&place);
            if let (Some(field), Some(sum)) = (self.fields.get(map), sums.get_mut(map)) {
                // Milligrams per kilogram: the maps are in mg/m^2.
                let weight = if self.mass { place.mass * 1e6 } else { 1.0 };
                self.add_to_texels(field, sum, place.position.as_vec3(), weight);
            }
        }
    }

    /// Area densities of all maps, row by row: 1/m^2, or mg/m^2. The sum of density times texel area over a map is the number or
    /// mass that lies on its surface, or was deposited there.
    pub fn densities(&self, sums: TexelSums) -> Vec<Vec<f32>> {
        let areas = self.fields.iter().map(Field::texel_area);
        sums.into_iter().zip(areas).map(|(sum, area)| sum.into_iter().map(|v| narrow(v / area)).collect()).collect()
    }

    /// Whether a catkin rests on the ground, including at the foot of a wall, and not on an obstacle.
    pub fn is_on_ground(&self, place: &RestingPlace) -> bool {
        self.map_index(place) == 0
    }

    /// Index of the map that counts a catkin: on a wall, that of the side whose normal is nearest to the contact normal; on top
    /// of an obstacle or under its eaves, that of its roof; on the ground, including at the foot of a wall, that of the ground.
    fn map_index(&self, place: &RestingPlace) -> usize {
        let Some(maps) = place.face.and_then(|i| self.obstacles.get(i as usize)?.as_ref()) else { return 0 };
        match (place.state, &maps.sides) {
            // In a corner of ground and wall `face` is the wall, but the catkin lies on the ground.
            (CatkinState::Corner, _) => 0,
            (CatkinState::OnWall, Some(sides)) if place.normal.y > UNDERSIDE_NORMAL_Y => {
                let facing = |k: &usize| sides[*k].normal.dot(place.normal);
                maps.roof + 1 + (0..4).max_by(|a, b| facing(a).total_cmp(&facing(b))).unwrap_or(0)
            }
            _ => maps.roof,
        }
    }

    /// Spreads a weight evenly over the texels whose centres lie within `blur` m of a world position, so that the total is kept.
    fn add_to_texels(&self, field: &Field, sum: &mut [f64], position: Vec3, weight: f64) {
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
        // A disc smaller than a texel may contain no centre: then add the whole weight to the texel below it.
        let nearest = nearest_texel(y, field.height) * field.width + nearest_texel(x, field.width);
        let texels = if texels.is_empty() { vec![nearest] } else { texels };
        let share = weight / texels.len() as f64;
        texels.iter().for_each(|t| sum[*t] += share);
    }
}

fn prism_of(solid: &Solid) -> Option<&Prism> {
    if let Form::Prism(prism) = &solid.form { Some(prism) } else { None }
}

/// The top of a box as the area of a map: rows run along +X and are stacked along +Z.
fn top_face(bounds: Bounds) -> Side {
    let size = bounds.size();
    Side { corner: bounds.min.with_y(bounds.max.y), along: Vec3::X * size.x, down: Vec3::Z * size.z, normal: Vec3::Y }
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::recipe::KeyTable as _;
    use osier_scene::solid::LandForm;

    #[test]
    fn the_map_of_the_ground_lies_at_its_height() {
        let inside = Bounds { min: Vec3::new(-5.0, -8.0, -5.0), max: Vec3::new(5.0, 4.0, 5.0) };
        let corner = |solids: Vec<Solid>, level: bool| {
            DepositionMaps::new(&FlightKeys::defaults(), inside, &Solids::new(solids, level)).fields[0].corner
        };
        let land = LandForm::new(3, 20.0, vec![-8.0; 9]).expect("land");
        let land = Solid { name: "land".into(), form: Form::Land(Arc::new(land)), humidity: 0.0 };
        assert_eq!(corner(vec![land], false), Vec3::new(-5.0, -8.0, -5.0));
        assert_eq!(corner(Vec::new(), true), Vec3::new(-5.0, 0.0, -5.0));
    }

    #[test]
    fn the_map_of_a_roof_holds_its_overhang() {
        let inside = Bounds { min: Vec3::new(-9.0, 0.0, -9.0), max: Vec3::new(9.0, 12.0, 9.0) };
        let house = Prism::house(Vec3::ZERO, Vec3::new(10.0, 5.0, 8.0), 3.0, 0.0);
        let slabs = house.roof_slabs(0.35, 0.16);
        let solid = |prism| Solid { name: "house".into(), form: Form::Prism(prism), humidity: 0.0 };
        let slabs = slabs.into_iter().map(solid).collect();
        let solids = Solids::new(vec![solid(house)], true).with_projections(vec![slabs]);
        let maps = DepositionMaps::new(&FlightKeys::defaults(), inside, &solids);
        // 0.35 m past both gables, and 0.28 m of the plan past both eaves.
        let roof = &maps.fields[1];
        assert!(roof.corner.distance(Vec3::new(-5.35, 8.0, -4.28)) < 1e-4, "{}", roof.corner);
        assert!((roof.along.length() - 10.7).abs() < 1e-4 && (roof.down.length() - 8.56).abs() < 1e-4);
        // The map of the back wall does not count a deposit on the underside, although that face points towards the back.
        let wall = RestingPlace {
            position: glam::DVec3::new(0.0, 4.6, 4.1),
            mass: 1e-6,
            state: CatkinState::OnWall,
            face: Some(0),
            normal: Vec3::Z,
        };
        let under = RestingPlace { normal: Vec3::new(0.0, -0.8, -0.6), ..wall };
        assert_eq!([&under, &wall].map(|place| maps.map_index(place)), [1, 2]);
    }
}
