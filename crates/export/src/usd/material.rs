//! Materials as UsdPreviewSurface networks.

use super::context::{MapTexture, UsdContext};
use super::layer_writer::{AttrHandle, AttrSpec, LayerWriter, PrimMetadata};
use super::value::UsdValue;
use osier_base::Result;
use osier_scene::{Coat, Material, MaterialClass, MaterialId};

/// Roughness of a film of water on a leaf. Own: 0 would be a mirror of single bright pixels.
const WATER_FILM_ROUGHNESS: f32 = 0.05;

/// Writes a material, the one of the scene with the index `id`, and its shaders. Returns the textures whose files change with the
/// frames.
pub(super) fn define_material(
    cx: &UsdContext,
    writer: &mut dyn LayerWriter,
    path: &str,
    m: &Material,
    id: MaterialId,
) -> Result<Vec<MapTexture>> {
    let coat = cx.mapped_coat(m);
    writer.define_prim(path, "Material", &PrimMetadata::default())?;
    let surface = format!("{path}/surface");
    writer.create_attr(
        &format!("{path}.outputs:surface"),
        &AttrSpec::connected("token", format!("{surface}.outputs:surface")),
        None,
    )?;
    if m.maps.height.is_some() {
        let source = format!("{surface}.outputs:displacement");
        writer.create_attr(&format!("{path}.outputs:displacement"), &AttrSpec::connected("token", source), None)?;
    }
    if m.translucency > 0.0 {
        // UsdPreviewSurface has no input for translucency; Blender shows this attribute as a custom property.
        let property = format!("{path}.userProperties:osier:translucency");
        writer.create_attr(
            &property,
            &AttrSpec { custom: true, ..AttrSpec::new("float") },
            Some(UsdValue::Float(m.translucency)),
        )?;
    }
    define_shader(writer, &surface, "UsdPreviewSurface")?;
    let mut s = ShaderInputWriter { writer, path: &surface, network: path };
    s.surface(m, coat)?;
    let maps = [m.maps.color, m.maps.normal, m.maps.roughness, m.maps.height];
    if coat.is_some() || maps.iter().any(Option::is_some) {
        define_st_reader(writer, path)?;
    }
    // Leaves show their texture once, unless their texture coordinates repeat it, as those of blades of grass do; bark
    // and ground repeat it.
    let is_leaf = matches!(m.class, MaterialClass::Leaf | MaterialClass::Catkin | MaterialClass::Water);
    let once = is_leaf && !cx.scene.repeats_textures(id);
    let named = ["color", "normal", "rough", "height"].into_iter().zip(maps);
    for (name, image) in named.filter_map(|(name, image)| image.map(|i| (name, i))) {
        let Some(image) = cx.scene.images.get(image as usize) else { continue };
        let file = format!("{}{}.png", cx.pictures, image.name);
        define_texture(writer, path, &TextureNode { name, file, material: m, once })?;
    }
    let Some(coat) = coat else { return Ok(Vec::new()) };
    // Programs that ignore time samples read the value without a time.
    let file = cx.coat_weight_file(&coat, cx.first);
    let attr = define_texture(writer, path, &TextureNode { name: coat.weight, file, material: m, once })?;
    Ok(vec![MapTexture { coat, attr }])
}

fn define_shader(writer: &mut dyn LayerWriter, path: &str, id: &str) -> Result<()> {
    writer.define_prim(path, "Shader", &PrimMetadata::default())?;
    writer.create_attr(&format!("{path}.info:id"), &AttrSpec::uniform("token"), Some(UsdValue::Token(id)))?;
    Ok(())
}

struct ShaderInputWriter<'a> {
    writer: &'a mut dyn LayerWriter,
    path: &'a str,
    network: &'a str,
}

impl ShaderInputWriter<'_> {
    fn input(&mut self, name: &str, type_name: &'static str, value: UsdValue) -> Result<()> {
        let path = format!("{}.inputs:{name}", self.path);
        self.writer.create_attr(&path, &AttrSpec::new(type_name), Some(value))?;
        Ok(())
    }

    fn connect(&mut self, name: &str, type_name: &'static str, source: &str) -> Result<()> {
        let source = format!("{}/{source}", self.network);
        let path = format!("{}.inputs:{name}", self.path);
        self.writer.create_attr(&path, &AttrSpec::connected(type_name, source), None)?;
        Ok(())
    }

    fn output(&mut self, name: &str, type_name: &'static str) -> Result<()> {
        self.writer.create_attr(&format!("{}.outputs:{name}", self.path), &AttrSpec::new(type_name), None)?;
        Ok(())
    }

    /// Inputs of the surface shader, from maps where there are any.
    fn surface(&mut self, m: &Material, coat: Option<Coat>) -> Result<()> {
        match m.maps.color {
            Some(_) => self.connect("diffuseColor", "color3f", "color.outputs:rgb")?,
            None => self.input("diffuseColor", "color3f", UsdValue::Float3(m.base_color))?,
        }
        if let (Some(_), Some(cutoff)) = (m.maps.color, m.alpha_cutoff) {
            self.connect("opacity", "float", "color.outputs:a")?;
            self.input("opacityThreshold", "float", UsdValue::Float(cutoff))?;
        } else if m.class == MaterialClass::Water {
            self.input("opacity", "float", UsdValue::Float(0.1))?;
        }
        match m.maps.roughness {
            Some(_) => self.connect("roughness", "float", "rough.outputs:r")?,
            None => self.input("roughness", "float", UsdValue::Float(m.roughness))?,
        }
        if let Some(coat) = coat {
            // A film over the surface; roughness and relief of the surface below it stay unchanged.
            self.connect("clearcoat", "float", &format!("{}.outputs:r", coat.weight))?;
            let is_bark = m.class == MaterialClass::Bark;
            let roughness = if is_bark { Coat::POROUS_WET_ROUGHNESS } else { WATER_FILM_ROUGHNESS };
            self.input("clearcoatRoughness", "float", UsdValue::Float(roughness))?;
        }
        self.input("ior", "float", UsdValue::Float(m.ior))?;
        self.input("metallic", "float", UsdValue::Float(0.0))?;
        if m.maps.normal.is_some() {
            self.connect("normal", "normal3f", "normal.outputs:rgb")?;
        }
        if m.maps.height.is_some() {
            self.connect("displacement", "float", "height.outputs:r")?;
            self.output("displacement", "token")?;
        }
        self.output("surface", "token")
    }
}

/// Defines the shader that reads the texture coordinates `st` for all textures of a material.
fn define_st_reader(writer: &mut dyn LayerWriter, network: &str) -> Result<()> {
    let path = format!("{network}/st");
    define_shader(writer, &path, "UsdPrimvarReader_float2")?;
    let mut s = ShaderInputWriter { writer, path: &path, network };
    s.input("varname", "string", UsdValue::String("st"))?;
    s.output("result", "float2")
}

/// A texture of a material; its shader prim has the same name.
struct TextureNode<'a> {
    name: &'static str,
    /// Path relative to the layer.
    file: String,
    material: &'a Material,
    /// Whether the texture ends at its edges instead of repeating.
    once: bool,
}

/// Writes the shader of a texture. Returns the attribute that holds the path of its file.
fn define_texture(writer: &mut dyn LayerWriter, network: &str, picture: &TextureNode) -> Result<AttrHandle> {
    let path = format!("{network}/{}", picture.name);
    define_shader(writer, &path, "UsdUVTexture")?;
    let file = writer.create_attr(
        &format!("{path}.inputs:file"),
        &AttrSpec::new("asset"),
        Some(UsdValue::Asset(&picture.file)),
    )?;
    let mut s = ShaderInputWriter { writer, path: &path, network };
    s.connect("st", "float2", "st.outputs:result")?;
    let color = picture.name == "color";
    s.input("sourceColorSpace", "token", UsdValue::Token(if color { "sRGB" } else { "raw" }))?;
    for side in ["wrapS", "wrapT"] {
        s.input(side, "token", UsdValue::Token(if picture.once { "clamp" } else { "repeat" }))?;
    }
    let (scale, bias) = match picture.name {
        "normal" => (Some(2.0), Some(-1.0)),
        // Displace bark both inwards and outwards, so that the wood keeps its mean radius; other reliefs only rise.
        "height" if picture.material.class == MaterialClass::Bark => {
            let height = picture.material.height_range;
            (Some(height), Some(-0.5 * height))
        }
        "height" => (Some(picture.material.height_range), None),
        _ => (None, None),
    };
    if let Some(v) = scale {
        s.input("scale", "float4", UsdValue::Float4([v, v, v, 1.0]))?;
    }
    if let Some(v) = bias {
        s.input("bias", "float4", UsdValue::Float4([v, v, v, 0.0]))?;
    }
    if color || picture.name == "normal" {
        s.output("rgb", "float3")?;
        if color && picture.material.alpha_cutoff.is_some() {
            s.output("a", "float")?;
        }
        return Ok(file);
    }
    s.output("r", "float")?;
    Ok(file)
}
