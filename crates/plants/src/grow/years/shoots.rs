//! From vigour to wood: selects the tips and buds that shoot this year, computes length and direction of their shoots, and adds
//! the buds of the new shoots.

use glam::{Quat, Vec3};

use super::habit::{Habit, ORDERS};
use super::light::LightField;
use super::season::Season;
use super::site::{Obstacles, Step};
use super::tree::{Bud, Node, Purpose, Tree, flag, index_of, y_axis};
use osier_base::Result;
use osier_base::limits::Limits;
use osier_base::math;
use osier_base::rng::{Rng, mix64, word};

/// Standard deviation of the length of a shoot, as a share of it: for tips, for buds.
const LENGTH_DEVIATION: [f32; 2] = [0.15, 0.2];
/// Least random factor on the length of a shoot: for tips, for buds.
const LENGTH_LEAST: [f32; 2] = [0.4, 0.3];
/// Largest magnitude of a normal draw. A shoot that even this draw would leave too short needs no draw.
const NORMAL_MAX: f32 = 5.8;
/// A tip that made a short shoot makes a long one only if that reaches this multiple of `short_shoot`.
const SHORT_STAYS: f32 = 1.6;
/// Length of the internode of a short shoot that a bud makes, as a share of `short_shoot`.
const SHORT_LENGTH: f32 = 0.8;
/// Shoots shorter than this multiple of `short_shoot` bear no buds; whorls need twice `short_shoot`.
const LONG_ENOUGH: [f32; 2] = [1.2, 2.0];
/// Standard deviation of the kink at which a side bud takes over from a dead apex, as a share of the angle of branches.
const KINK_DEVIATION: f32 = 0.2;
/// Length over which such a kink of the stem is distributed, m: later wood, which follows the chord of the pith, hides the kink
/// in a thick stem.
const STEM_KINK_LENGTH: f32 = 0.4;
/// Deviation of the elevation of an axis from that of its order, as a share of the deviation of the angle at which it left its parent.
const ELEVATION_SPREAD: f32 = 1.0;
/// Largest deviation of that angle, in standard deviations, that the elevation follows.
const DEVIATION_MAX: f32 = 2.5;
/// Range of the angle at which a shoot leaves its parent, degrees.
const LEAVE_RANGE: [f32; 2] = [5.0, 150.0];
/// Deviation of the azimuth of buds, degrees.
const AZIMUTH_DEVIATION: f32 = 8.0;
/// Divergence beyond which buds are two-ranked, degrees. Only level shoots keep two ranks; along upright stems the ranks rotate.
const TWO_RANKED: f32 = 150.0;
/// Radius of a new shoot at its tip as a share of that at its base.
const TIP_TAPER: f32 = 0.6;
/// Smallest number of branches of a whorl, as a share of that of the strongest whorl.
const WHORL_LEAST: f32 = 0.35;
/// Projected directions whose squared length is below this count as zero.
pub(super) const LEVEL_EPSILON: f32 = 1e-6;

/// A shoot planned for this year.
#[derive(Debug, Clone, Copy)]
struct Shoot {
    /// Node from whose end it grows.
    node: u32,
    /// The bud from which it grows; `None` for the tip of the node.
    bud: Option<Bud>,
    /// Length that the shoot reaches this year, m.
    length: f32,
    /// Number of internodes into which it is divided.
    count: u16,
}

/// The turn of an axis where a side bud takes over from a dead apex.
#[derive(Debug, Clone, Copy)]
struct Kink {
    /// Unit vector about which it turns, across the axis.
    about: Vec3,
    /// Angle, rad.
    angle: f32,
}

/// A power of a number that is not negative. For the exponents of most tables no logarithm is computed.
fn power(x: f32, exponent: f32) -> f32 {
    let is = |whole: f32| (exponent - whole).abs() < 1e-6;
    if is(1.0) {
        x
    } else if is(2.0) {
        x * x
    } else if is(3.0) {
        x * x * x
    } else if is(4.0) {
        (x * x) * (x * x)
    } else {
        math::pow_f32(x, exponent)
    }
}

/// Decline of growth with the length of the water path and with height, 1 to 0.
/// Source: max(0, 1 - (path / path_max)^a) max(0, 1 - (height / height_max)^b).
fn hydraulics(habit: &Habit, path: f32, height: f32) -> f32 {
    // The base of the power must not be negative, as for the height of roots of a plant on a slope.
    let decline = |part: f32, exponent: f32| (1.0 - power(part.max(0.0), exponent)).max(0.0);
    decline(path / habit.path_max, habit.path_power) * decline(height / habit.height_max, habit.height_power)
}

impl Tree {
    /// Grows the shoots of a year: plans and counts all of them before it adds the first.
    /// # Errors
    /// `Limit` if the tree would have more nodes than allowed.
    pub fn shoot(
        &mut self,
        season: &Season,
        field: &LightField,
        obstacles: Obstacles<'_>,
        limits: &Limits,
    ) -> Result<()> {
        let mut shoots = Vec::new();
        self.plan_tips(season, &mut shoots);
        self.plan_buds(season, field, &mut shoots);
        // Count all internodes of the year before the first is added.
        let new: u64 = shoots.iter().map(|s| u64::from(s.count)).sum();
        let standing = (self.nodes.len() - self.fallen) as u64;
        let what = || format!("nodes of plant \"{}\" in year {}", self.name, season.year);
        limits.check("nodes", standing + new, &what())?;
        for shoot in &shoots {
            self.grow_shoot(shoot, season, field, obstacles);
        }
        Ok(())
    }

    /// Plans the shoots of open tips; a tip with too little vigour for a long shoot remains a short shoot.
    fn plan_tips(&mut self, season: &Season, shoots: &mut Vec<Shoot>) {
        let habit = &self.habit;
        // Largest random factor on the length of a shoot.
        let luck = 1.0 + LENGTH_DEVIATION[0] * NORMAL_MAX;
        for i in 0..self.nodes.len() {
            if !self.nodes.grows(i) {
                continue;
            }
            let order = usize::from(self.nodes.order[i]);
            // Borchert-Honda: `factor` is vigour per light at the node, of which the continuation gets the share `control`.
            let vigour = self.scratch.factor[i] * self.control_at(season, i) * self.scratch.main[i];
            let leader = if order == 0 { season.leader } else { 1.0 };
            let was_short = self.nodes.flags[i] & flag::SHORT != 0;
            let needed = habit.short_shoot * if was_short { SHORT_STAYS } else { 1.0 };
            let most = vigour * habit.shoot_rate[order] * season.juvenile * leader;
            let mut length = 0.0;
            // Most tips are far from a long shoot and need neither powers nor draws.
            if most * luck >= needed {
                let declined = hydraulics(habit, self.nodes.path[i], self.nodes.p[i].y);
                // 1 - (s / axis_max)^2: axes grow almost undiminished over most of their length and stop at axis_max.
                let part = self.nodes.s[i] / habit.axis_max[order];
                let wanted = most * declined * (1.0 - part * part).max(0.0);
                let wanted = wanted.min(habit.shoot_max[order] * leader);
                if wanted * luck >= needed {
                    let chance = Chance { deviation: LENGTH_DEVIATION[0], least: LENGTH_LEAST[0] };
                    length = chance.length(wanted, needed, &mut self.tip_draw(i, season.year));
                }
            }
            // Below the threshold the tip bears its rosette again, but no wood. A short shoot needs more vigour to become long
            // than a long one to stay long (`SHORT_STAYS`), so that spurs stay spurs from year to year.
            if length < needed {
                self.nodes.flags[i] |= flag::SHORT;
            } else {
                let count = internodes(length, habit.internode[order]);
                shoots.push(Shoot { node: index_of(i), bud: None, length, count });
            }
        }
    }

    /// Plans the shoots of lit buds; unlit buds wait, and finally become dormant.
    fn plan_buds(&mut self, season: &Season, field: &LightField, shoots: &mut Vec<Shoot>) {
        let buds = std::mem::take(&mut self.buds);
        for mut bud in buds {
            let i = bud.node as usize;
            if !self.nodes.lives(i) {
                continue;
            }
            let parent_order = usize::from(self.nodes.order[i]);
            let order = parent_order + 1;
            // The share of the vigour at the node that goes to side branches, in proportion to the light of this bud.
            let vigour = self.scratch.factor[i] * (1.0 - self.control_at(season, i)) * bud.gathered;
            // Unlit buds wait; after `bud_life` years they become dormant buds, which may still break when light returns.
            if vigour <= 0.0 || order >= ORDERS {
                bud.age = bud.age.saturating_add(1);
                if f32::from(bud.age) > self.habit.bud_life {
                    let light = self.scratch.cell.get(i).map_or(0.0, |cell| field.in_cell(*cell).q);
                    self.add_dormant(i, self.axis_of_bud(&bud), light);
                } else {
                    self.buds.push(bud);
                }
                continue;
            }
            let habit = &self.habit;
            let declined = hydraulics(habit, self.nodes.path[i], self.nodes.p[i].y);
            let wanted = (vigour * habit.shoot_rate[order] * season.juvenile * declined).min(habit.shoot_max[order]);
            // If even the largest random factor leaves the shoot short, no factor is drawn. Each draw has its own
            // address, so that skipping one changes no other.
            let luck = 1.0 + LENGTH_DEVIATION[1] * NORMAL_MAX;
            let mut length = 0.0;
            if wanted * luck >= habit.short_shoot {
                let mut draw = self.draw(self.axis_of_bud(&bud), Purpose::Extend);
                let chance = Chance { deviation: LENGTH_DEVIATION[1], least: LENGTH_LEAST[1] };
                length = chance.length(wanted, habit.short_shoot, &mut draw);
            }
            let short = length < habit.short_shoot;
            let length = if short { SHORT_LENGTH * habit.short_shoot } else { length };
            let count = if short { 1 } else { internodes(length, habit.internode[order]) };
            shoots.push(Shoot { node: bud.node, bud: Some(bud), length, count });
        }
    }

    /// Id of the axis that grows from a bud, the same in every run: a hash of the bearing axis, the node and the bud's slot.
    fn axis_of_bud(&self, bud: &Bud) -> u64 {
        let i = bud.node as usize;
        // Slots are below 64, including those of woken buds, so that the ordinals of the nodes of an axis are unique.
        let ordinal = u64::from(self.nodes.index[i]) * 64 + u64::from(bud.slot);
        mix64(&[self.axis_ids[self.nodes.axis[i] as usize], word("bud"), ordinal])
    }

    /// Random stream of a tip in a year: first the length of its shoot, then the death of its apex.
    fn tip_draw(&self, i: usize, year: u32) -> Rng {
        self.draw(mix64(&[self.node_id(i), u64::from(year)]), Purpose::Extend)
    }

    /// Adds the internodes of a shoot and their buds; an obstacle may end the shoot early.
    fn grow_shoot(&mut self, shoot: &Shoot, season: &Season, field: &LightField, obstacles: Obstacles<'_>) {
        let from = shoot.node as usize;
        let order = usize::from(self.nodes.order[from]) + usize::from(shoot.bud.is_some());
        // Begin from a bud at an angle to the node, or from a tip straight on or, after the death of the apex, with a kink.
        let (axis, first_index, mut azimuth, mut q) = match &shoot.bud {
            Some(bud) => {
                let id = self.axis_of_bud(bud);
                let deviation = self.leaving_deviation(id);
                self.axis_ids.push(id);
                self.axis_elevations.push(axis_elevation(deviation, order, season));
                let q = self.leaving_frame(bud, order, season, deviation);
                (index_of(self.axis_ids.len() - 1), 0, self.first_azimuth(id), q)
            }
            None => {
                let azimuth = self.nodes.azimuth[from] + self.divergence(order);
                (self.nodes.axis[from], self.nodes.index[from].saturating_add(1), azimuth, self.nodes.q[from])
            }
        };
        let kink = if shoot.bud.is_none() { self.relay_kink(from, order, season) } else { None };
        let is_short = shoot.bud.is_some() && shoot.length < self.habit.short_shoot;

        // For each internode: turn, slide along obstacles, add the node and its buds.
        let count = f32::from(shoot.count);
        let length = shoot.length / count;
        let light = self.scratch.cell.get(from).map_or(Vec3::Y, |cell| field.in_cell(*cell).from);
        let turns = Turns::new(&self.habit, order, self.axis_elevations[axis as usize], length, light);
        let axis_id = self.axis_ids[axis as usize];
        // A branch bends at once, the stem over several internodes.
        let bending = if order == 0 { internodes(STEM_KINK_LENGTH, length).min(shoot.count) } else { 1 };
        let bend = kink.map(|kink| rotation(kink.about, kink.angle / f32::from(bending)));
        let mut parent = from;
        let mut at = self.nodes.p[from];
        let mut end_flag = flag::OPEN;
        for j in 0..shoot.count {
            let index = first_index.saturating_add(j);
            let id = osier_base::rng::child(axis_id, u64::from(index));
            if let Some(bend) = bend.filter(|_| j < bending) {
                q = (bend * q).normalize();
            }
            let d = y_axis(q);
            let wanted = Step { d: turns.turn(d, &mut self.draw(id, Purpose::Wander)), length };
            let t = (f32::from(j) + 1.0) / count;
            // Longer shoots are thicker; each tapers linearly to its tip. From the next year the pipe model determines the
            // radius.
            let radius = self.habit.tip_radius + self.habit.stout[order] * shoot.length * (1.0 - TIP_TAPER * t);
            let Some(step) = obstacles.slide(at, wanted, radius) else {
                end_flag = flag::OBSTACLE;
                break;
            };
            // Take the smallest rotation to the new direction, so that frames do not twist.
            q = (math::rotation_between(d, step.d) * q).normalize();
            at += step.d * step.length;
            let is_first_of_bud = j == 0 && shoot.bud.is_some();
            let s = if is_first_of_bud { 0.0 } else { self.nodes.s[parent] };
            let row = Node {
                parent: index_of(parent),
                axis,
                index,
                // At most 6 orders: `habit.orders()` ends branching.
                order: u8::try_from(order).unwrap_or(u8::MAX),
                flags: if is_first_of_bud { 0 } else { flag::MAIN },
                dormant: 0,
                woken: 0,
                starve: 0,
                death: 0,
                p: at,
                q,
                length: step.length,
                r: radius,
                area: math::pow_f32(radius, self.habit.pipe_exponent),
                lost: 0.0,
                path: self.nodes.path[parent] + step.length,
                s: s + step.length,
                moment: 0.0,
                birth: season.year as f32 - 1.0 + t,
                azimuth,
                light: 0.0,
                gathered: 0.0,
                vigour: 0.0,
            };
            parent = self.nodes.len();
            self.nodes.push(row);
            let last = j + 1 == shoot.count;
            azimuth += self.add_buds(parent, id, shoot.length, t, last);
        }
        // The last internode now bears the tip.
        if parent != from {
            self.nodes.flags[parent] |= end_flag | if is_short { flag::SHORT } else { 0 };
            self.nodes.gathered[parent] = 0.0;
        }
        if shoot.bud.is_none() {
            self.nodes.flags[from] &= !(flag::OPEN | flag::SHORT);
            if parent == from {
                self.nodes.flags[from] |= flag::OBSTACLE;
            }
        }
    }

    /// Azimuth of the first bud of an axis: level for two ranks, random for spiral phyllotaxis.
    fn first_azimuth(&self, axis_id: u64) -> f32 {
        if self.habit.divergence > TWO_RANKED || self.habit.buds > 1.5 {
            0.0
        } else {
            self.draw(axis_id, Purpose::Azimuth).unit_f32() * std::f32::consts::TAU
        }
    }

    /// Angle from the buds of one node to those of the next, rad. Own: along the upright stem two ranks become a spiral.
    fn divergence(&self, order: usize) -> f32 {
        if self.habit.buds > 1.5 {
            std::f32::consts::FRAC_PI_2
        } else if order == 0 && self.habit.divergence > TWO_RANKED {
            osier_base::math::GOLDEN_ANGLE_F32
        } else {
            self.habit.divergence.to_radians()
        }
    }

    /// Frame of the base of a side shoot: rotated away from the node by its angle, at the bud's azimuth. `deviation`: deviation
    /// of that angle from the mean, in standard deviations.
    fn leaving_frame(&self, bud: &Bud, order: usize, season: &Season, deviation: f32) -> Quat {
        let q = self.nodes.q[bud.node as usize];
        let d = y_axis(q);
        let range = LEAVE_RANGE.map(f32::to_radians);
        let angle = (season.angle[order] + season.angle_var * deviation).clamp(range[0], range[1]);
        // The vector across the parent, flattened towards the level plane.
        let across = q * Vec3::new(math::cos_f32(bud.azimuth), 0.0, math::sin_f32(bud.azimuth));
        let upright = Vec3::Y - d * d.y;
        let planar = self.habit.planar[order];
        let side = if planar > 0.0 && upright.length_squared() > LEVEL_EPSILON {
            let normal = upright.normalize();
            math::normalize_or(across - normal * (planar * across.dot(normal)), across)
        } else {
            across
        };
        let out = d * math::cos_f32(angle) + side * math::sin_f32(angle);
        // The roll reference is level, so that two ranks of buds lie level.
        let level = math::normalize_or(Vec3::Y.cross(out), math::perpendicular(out));
        Quat::from_mat3(&glam::Mat3::from_cols(level, out, level.cross(out))).normalize()
    }

    /// Deviation from the mean of the angle at which an axis leaves its parent, in standard deviations.
    pub(super) fn leaving_deviation(&self, axis_id: u64) -> f32 {
        PolarDraw::new(&mut self.draw(axis_id, Purpose::Leave)).normal()
    }

    /// Turn of the continuation of a tip where its apex dies and a side bud takes over.
    fn relay_kink(&self, from: usize, order: usize, season: &Season) -> Option<Kink> {
        let death = f64::from(self.habit.apex_death[order]);
        if death <= 0.0 {
            return None;
        }
        // The first draw of this stream gave the length of the shoot.
        let mut draw = self.tip_draw(from, season.year);
        PolarDraw::new(&mut draw);
        if !draw.chance(death) {
            return None;
        }
        let side = season.angle[(order + 1).min(ORDERS - 1)];
        let angle = side * (self.habit.kink[order] + KINK_DEVIATION * PolarDraw::new(&mut draw).normal());
        let azimuth = draw.unit_f32() * std::f32::consts::TAU;
        let about = self.nodes.q[from] * Vec3::new(math::cos_f32(azimuth), 0.0, math::sin_f32(azimuth));
        Some(Kink { about, angle })
    }

    /// Adds the buds at the end of a new internode; returns the difference in azimuth between its buds and those of the next
    /// node. `length`: length of the whole shoot, m; `t`: position along it, 0..1.
    fn add_buds(&mut self, node: usize, id: u64, length: f32, t: f32, last: bool) -> f32 {
        let habit = &self.habit;
        let order = usize::from(self.nodes.order[node]);
        let next = order + 1;
        let turn = self.divergence(order);
        // Short shoots are spurs without side buds.
        if next >= habit.orders() || length < LONG_ENOUGH[0] * habit.short_shoot {
            return turn;
        }
        let whorled = habit.whorl[order] > 0.0;
        let alive = f64::from(habit.bud_break[order]);
        let (count, chance, spacing) = if whorled {
            if last && length > LONG_ENOUGH[1] * habit.short_shoot {
                // Strong leaders make full whorls: the number of branches is proportional to the square root of the relative
                // length.
                let size = (length / habit.shoot_max[order]).sqrt().clamp(WHORL_LEAST, 1.0);
                let count = super::habit::whole(habit.whorl[order] * size).clamp(1, 12);
                (count, alive, std::f32::consts::TAU / f32::from(count))
            } else {
                (1, f64::from(habit.internodal) * alive, 0.0)
            }
        } else {
            // `buds` is 1 (alternate) or 2 (opposite). Acrotony favours the buds near the tip: t^acrotony.
            let count = if habit.buds > 1.5 { 2 } else { 1 };
            (count, alive * f64::from(power(t, habit.acrotony)), std::f32::consts::PI)
        };
        let mut draw = self.draw(id, Purpose::Buds);
        let deviation = AZIMUTH_DEVIATION.to_radians();
        for slot in 0..count {
            // Draw both numbers for dead buds too, so that the death of one bud does not change the next bud.
            let lives = draw.chance(chance);
            let jitter = PolarDraw::new(&mut draw);
            if lives {
                let jitter = deviation * jitter.normal();
                let azimuth = self.nodes.azimuth[node] + f32::from(slot) * spacing + jitter;
                // At most 12 buds in a whorl, 2 elsewhere.
                let slot = u8::try_from(slot).unwrap_or(0);
                self.buds.push(Bud { node: index_of(node), azimuth, slot, age: 0, gathered: 0.0 });
            } else if self.habit.epicormic > 0.0 {
                self.add_dormant(node, mix64(&[id, u64::from(slot)]), 1.0);
            }
        }
        turn
    }
}

/// Number of internodes of a shoot: none longer than `internode` (m), at least 1.
fn internodes(length: f32, internode: f32) -> u16 {
    super::habit::whole((length / internode).ceil().max(1.0))
}

/// Sine and cosine of the elevation towards which an axis of an order turns. `deviation`: deviation from the mean of the angle at
/// which it leaves its parent, in standard deviations.
/// Own: an axis that leaves its parent at a wider angle than others stays lower than they do, by as much; axes near the vertical
/// keep close to it. With one elevation for all, the limbs of a tree would become parallel.
pub(super) fn axis_elevation(deviation: f32, order: usize, season: &Season) -> [f32; 2] {
    let [sine, cosine] = season.elevation[order];
    let spread = season.angle_var * ELEVATION_SPREAD * cosine;
    if order == 0 || spread <= 0.0 {
        return [sine, cosine];
    }
    // `lower` is the tangent of the angle by which the axis is lower; the angle therefore stays below 90 degrees.
    let lower = spread * deviation.clamp(-DEVIATION_MAX, DEVIATION_MAX);
    let per_length = 1.0 / (1.0 + lower * lower).sqrt();
    [(sine - lower * cosine) * per_length, ((cosine + lower * sine) * per_length).max(0.0)]
}

/// Two uniform draws, from which a pair of independent standard normal draws (Box-Muller) is computed only if it is needed.
#[derive(Debug, Clone, Copy)]
pub(super) struct PolarDraw {
    /// Draw of the distance from the origin.
    away: f32,
    /// Angle, as a part of a full turn.
    turn: f32,
}

impl PolarDraw {
    /// Takes two draws from a stream.
    #[inline]
    pub fn new(draw: &mut Rng) -> Self {
        Self { away: draw.unit_f32(), turn: draw.unit_f32() }
    }

    /// Distance from the origin, 0 to [`NORMAL_MAX`].
    #[inline]
    fn distance(self) -> f32 {
        // 1 - u lies in (0, 1], so that the logarithm is finite.
        (-2.0 * math::ln_f32(1.0 - self.away)).sqrt()
    }

    /// An upper bound of [`Self::normal`], at least 0, that needs neither logarithm nor cosine.
    #[inline]
    fn bound(self) -> f32 {
        self.distance_bound() * self.cosine_bound()
    }

    /// An upper bound of [`Self::distance`]: its values at a half, 0.86 and 0.98, rounded up, and at the largest draw.
    #[inline]
    fn distance_bound(self) -> f32 {
        if self.away < 0.5 {
            1.178
        } else if self.away < 0.86 {
            1.984
        } else if self.away < 0.98 {
            2.798
        } else {
            NORMAL_MAX
        }
    }

    /// An upper bound of the cosine of the angle, at least 0: its values at the ends of sixteenths of a turn, rounded
    /// up.
    #[inline]
    fn cosine_bound(self) -> f32 {
        // The cosine is even about half a turn.
        let turn = self.turn.min(1.0 - self.turn);
        if turn < 0.0625 {
            1.0
        } else if turn < 0.125 {
            0.924
        } else if turn < 0.1875 {
            0.708
        } else if turn < 0.25 {
            0.383
        } else {
            0.0
        }
    }

    /// One standard normal draw, magnitude at most [`NORMAL_MAX`].
    #[inline]
    pub fn normal(self) -> f32 {
        self.distance() * math::cos_f32(std::f32::consts::TAU * self.turn)
    }

    /// Two independent standard normal draws, the first of which is [`Self::normal`].
    #[inline]
    fn pair(self) -> [f32; 2] {
        let (distance, angle) = (self.distance(), std::f32::consts::TAU * self.turn);
        [distance * math::cos_f32(angle), distance * math::sin_f32(angle)]
    }
}

/// The random factor on the length of a shoot; its mean is 1.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chance {
    /// Its standard deviation.
    pub deviation: f32,
    /// Its least value, below 1.
    pub least: f32,
}

impl Chance {
    /// The length of a shoot with the mean `wanted`; 0 if it is less than `needed`. The normal draw is not computed if it cannot
    /// reach that length.
    pub fn length(self, wanted: f32, needed: f32, draw: &mut Rng) -> f32 {
        // Exceeds 1 by more than the rounding errors of both sides of the comparison.
        const SURE: f32 = 1.0001;
        let falls_short = |normal: f32| wanted * (1.0 + self.deviation * normal) * SURE < needed;
        let draw = PolarDraw::new(draw);
        if falls_short(draw.bound()) {
            return 0.0;
        }
        let length = wanted * (1.0 + self.deviation * draw.normal()).max(self.least);
        if length < needed { 0.0 } else { length }
    }
}

fn rotation(about: Vec3, angle: f32) -> Quat {
    let v = about * math::sin_f32(0.5 * angle);
    Quat::from_xyzw(v.x, v.y, v.z, math::cos_f32(0.5 * angle))
}

/// Parameters of the turns of a shoot's internodes; only the random term differs from internode to internode.
struct Turns {
    /// Standard deviation of the random turn's components.
    wander: f32,
    /// Share of the turn towards the elevation that one internode makes, 0..1.
    rise: f32,
    /// Sine and cosine of the elevation towards which the axis turns.
    elevation: [f32; 2],
    /// Direction of the light, times the phototropism and the length of an internode.
    light: Vec3,
}

impl Turns {
    fn new(habit: &Habit, order: usize, elevation: [f32; 2], length: f32, light: Vec3) -> Self {
        Self {
            wander: habit.wander[order] * length.sqrt(),
            rise: 1.0 - math::exp_f32(-habit.elevation_rate[order] * length),
            elevation,
            light: light * (habit.phototropism[order] * length),
        }
    }

    /// The direction after one more internode.
    /// Source: d' = normalize(d + wander sqrt(l) N3 + (e - d)(1 - exp(-rate l)) + phototropism l g).
    fn turn(&self, d: Vec3, draw: &mut Rng) -> Vec3 {
        let mut to = d + self.light;
        if self.wander > 0.0 {
            let ([x, y], z) = (PolarDraw::new(draw).pair(), PolarDraw::new(draw).normal());
            to += Vec3::new(x, y, z) * self.wander;
        }
        if self.rise > 0.0 {
            to += (raised(d, self.elevation) - d) * self.rise;
        }
        math::normalize_or(to, d)
    }
}

/// The heading of a direction, raised to an elevation given by sine and cosine. An upright direction heads to +X.
pub(super) fn raised(d: Vec3, [sine, cosine]: [f32; 2]) -> Vec3 {
    let level = Vec3::new(d.x, 0.0, d.z);
    let heading = if level.length_squared() > LEVEL_EPSILON { level.normalize() } else { Vec3::X };
    heading * cosine + Vec3::Y * sine
}
