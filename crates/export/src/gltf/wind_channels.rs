//! Wind channels: data in the vertex colours of plants that shaders of engines read.

use osier_base::math::narrow;
use osier_base::rng::mix64;
use osier_scene::{Attribute, AttributeData, Mesh};

/// A number of a vertex from 0 to 1 that a shader of wind reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WindNumber {
    /// Sway with the whole plant: 0 at the root.
    Sway,
    /// Sway with the branches: 0 on the trunk.
    Branch,
    /// Flutter: 0 on wood, 1 at the tip of a leaf.
    Flutter,
    /// Phase of the main branch, random.
    Phase,
    /// Share of the light of the sky that reaches the vertex.
    Light,
    /// A random number of the branch or leaf.
    Id,
    /// 0 everywhere, for a channel without a use.
    Zero,
    /// 1 everywhere, for a factor without effect, such as alpha.
    One,
}

impl WindNumber {
    /// Its name in scene files and in the extras of meshes.
    pub fn word(self) -> &'static str {
        match self {
            Self::Sway => "sway",
            Self::Branch => "branch",
            Self::Flutter => "flutter",
            Self::Phase => "phase",
            Self::Light => "light",
            Self::Id => "id",
            Self::Zero => "zero",
            Self::One => "one",
        }
    }
}

/// A component of a vertex colour or of TEXCOORD_1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WindChannel {
    /// Which number of the vertex the channel holds, before it is inverted.
    pub number: WindNumber,
    /// Whether the channel holds 1 minus the number; names of inverted channels begin with `-`.
    pub inverted: bool,
}

/// Wind numbers in the vertex colours and in TEXCOORD_1, as the shader of an engine expects them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WindChannels {
    /// Red, green, blue, alpha of COLOR_0.
    pub color: [WindChannel; 4],
    /// Both numbers of TEXCOORD_1, if the shader reads them.
    pub second_uv: Option<[WindChannel; 2]>,
}

const fn plain(number: WindNumber) -> WindChannel {
    WindChannel { number, inverted: false }
}

impl WindChannels {
    /// The shader of Crysis (GPU Gems 3, chapter 16), Lumberyard and O3DE.
    pub const CRYSIS: Self = Self {
        color: [
            plain(WindNumber::Flutter),
            plain(WindNumber::Phase),
            plain(WindNumber::Branch),
            plain(WindNumber::Light),
        ],
        second_uv: None,
    };
    /// Unity's shader for trees: phase, flutter and light in the colour, sway and branch in TEXCOORD_1.
    pub const UNITY: Self = Self {
        color: [
            plain(WindNumber::Phase),
            plain(WindNumber::Flutter),
            plain(WindNumber::Zero),
            plain(WindNumber::Light),
        ],
        second_uv: Some([plain(WindNumber::Sway), plain(WindNumber::Branch)]),
    };
    /// Godot's trees: green vertices sway most, red ones not at all.
    pub const GODOT: Self = Self {
        color: [
            WindChannel { number: WindNumber::Sway, inverted: true },
            plain(WindNumber::Sway),
            plain(WindNumber::Zero),
            plain(WindNumber::One),
        ],
        second_uv: None,
    };
    /// Unreal: alpha is free, since voxelised meshes overwrite it.
    pub const UNREAL: Self = Self {
        color: [
            plain(WindNumber::Flutter),
            plain(WindNumber::Phase),
            plain(WindNumber::Branch),
            plain(WindNumber::Zero),
        ],
        second_uv: None,
    };

    /// Names of the channels as in scene files, colour first, for the extras of meshes.
    pub(super) fn words(&self) -> Vec<String> {
        let word = |c: &WindChannel| format!("{}{}", if c.inverted { "-" } else { "" }, c.number.word());
        self.color.iter().chain(self.second_uv.iter().flatten()).map(word).collect()
    }

    /// Red, green, blue and alpha of a vertex, 0 to 1.
    pub(super) fn color_of(&self, wind: &VertexWind) -> [f32; 4] {
        self.color.map(|c| wind.channel(c))
    }

    /// Both numbers of TEXCOORD_1 of a vertex; 0 if the shader reads none.
    pub(super) fn second_uv_of(&self, wind: &VertexWind) -> [f32; 2] {
        self.second_uv.map_or([0.0; 2], |uv| uv.map(|c| wind.channel(c)))
    }
}

/// Name of the attribute that is written as TEXCOORD_1.
pub(super) const SECOND_UV: &str = "second_uv";

/// Parameters of the wind at a vertex, see [`WindNumber`]; all from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct VertexWind {
    pub sway: f32,
    pub branch: f32,
    pub flutter: f32,
    pub phase: f32,
    pub light: f32,
    pub id: f32,
}

impl VertexWind {
    /// A vertex that does not sway, in full light.
    pub(super) const STILL: Self = Self { sway: 0.0, branch: 0.0, flutter: 0.0, phase: 0.0, light: 1.0, id: 0.0 };

    fn channel(&self, channel: WindChannel) -> f32 {
        let value = match channel.number {
            WindNumber::Sway => self.sway,
            WindNumber::Branch => self.branch,
            WindNumber::Flutter => self.flutter,
            WindNumber::Phase => self.phase,
            WindNumber::Light => self.light,
            WindNumber::Id => self.id,
            WindNumber::Zero => 0.0,
            WindNumber::One => 1.0,
        };
        if channel.inverted { 1.0 - value } else { value }
    }
}

/// Wind at the vertices of a mesh, from its attributes `wind` and `wind2`; [`VertexWind::STILL`] without them.
pub(super) fn wind_of_mesh(mesh: &Mesh) -> Vec<VertexWind> {
    let find = |name: &str| mesh.attributes.iter().find(|a: &&Attribute| a.name == name).map(|a| &a.data);
    // Meshes without the attributes stand still: ground, solids, hairs.
    let mut list = vec![VertexWind::STILL; mesh.points.len()];
    if let Some(AttributeData::Unit4(wind)) = find("wind") {
        for (v, [sway, phase, flutter, light]) in list.iter_mut().zip(wind) {
            *v = VertexWind { sway: *sway, phase: *phase, flutter: *flutter, light: *light, ..*v };
        }
    }
    if let Some(AttributeData::Unit2(branch)) = find("wind2") {
        for (v, [branch, id]) in list.iter_mut().zip(branch) {
            *v = VertexWind { branch: *branch, id: *id, ..*v };
        }
    }
    list
}

/// A pseudorandom number from 0 to 1 that depends only on the id of a leaf.
pub(super) fn number_of_id(id: u64) -> f32 {
    // The upper 24 bits fill the fraction of a float.
    let top = (mix64(&[id]) >> 40) as u32;
    narrow(f64::from(top) / f64::from((1_u32 << 24) - 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_put_each_number_where_its_shader_reads_it() {
        let wind = VertexWind { sway: 0.1, branch: 0.2, flutter: 0.3, phase: 0.4, light: 0.5, id: 0.6 };
        let is = |got: &[f32], want: &[f32]| got.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(is(&WindChannels::CRYSIS.color_of(&wind), &[0.3, 0.4, 0.2, 0.5]));
        assert!(is(&WindChannels::UNITY.color_of(&wind), &[0.4, 0.3, 0.0, 0.5]));
        assert!(is(&WindChannels::UNITY.second_uv_of(&wind), &[0.1, 0.2]));
        assert!(is(&WindChannels::GODOT.color_of(&wind), &[0.9, 0.1, 0.0, 1.0]));
        assert!(is(&WindChannels::UNREAL.color_of(&wind), &[0.3, 0.4, 0.2, 0.0]));
    }

    #[test]
    fn numbers_of_ids_fill_the_interval() {
        let list: Vec<f32> = (0..1000).map(number_of_id).collect();
        let mean = list.iter().sum::<f32>() / 1000.0;
        assert!(list.iter().all(|n| (0.0..=1.0).contains(n)) && (mean - 0.5).abs() < 0.05, "{mean}");
    }
}
