//! What must hold before anything is written: finite numbers, indices in range, arrays of equal length.

use glam::Vec3;

use super::{
    AssetFrame, Attribute, AttributeData, AttributeDomain, CurvesFrame, Frame, InstanceState, Instancer,
    InstancerFrame, Mesh, MeshFrame, PointsFrame, Scene,
};
use osier_base::{Error, Result};

/// Checks meshes, instancers, clouds and curves of all assets at rest, before an exporter reads them.
/// # Errors
/// X001 for a number that is not finite, X006 for subsets that do not cover a mesh, naming asset and element.
pub fn check_scene(scene: &Scene) -> Result<()> {
    for asset in &scene.assets {
        for object in &asset.meshes {
            check_mesh(&object.mesh, &format!("asset {}, mesh {}", asset.id, object.name))?;
        }
        for instancer in &asset.instancers {
            let place = format!("asset {}, instancer {}", asset.id, instancer.name);
            for proto in instancer.prototypes.iter().flat_map(|p| std::iter::once(p).chain(&p.others)) {
                let place = format!("{place}, prototype {}", proto.name);
                check_mesh(&proto.mesh, &place)?;
                if let Some(fine) = &proto.fine {
                    check_mesh(&fine.mesh, &place)?;
                    finite(&fine.curves.points, &place, "point")?;
                    finite_scalars(&fine.curves.widths, &place, "width")?;
                }
            }
            finite(&instancer.scales, &place, "scale")?;
            check_state(instancer, &instancer.rest, &place)?;
        }
        for cloud in &asset.points {
            let place = format!("asset {}, points {}", asset.id, cloud.name);
            finite(&cloud.positions, &place, "position")?;
            finite_scalars(&cloud.widths, &place, "width")?;
            check_attributes(&cloud.attributes, AttributeDomain::Point, cloud.positions.len(), &place)?;
        }
        for curves in &asset.curves {
            finite(&curves.points, &format!("asset {}, curves {}", asset.id, curves.name), "point")?;
        }
    }
    Ok(())
}

/// Checks that the lists of a frame are finite and as long as those of the scene that they replace.
/// # Errors
/// X001 naming asset, element and frame; X008 if the number of instances changes.
pub fn check_frame(scene: &Scene, frame: &Frame) -> Result<()> {
    // Every list that a frame carries must be finite and as long as the list of the scene that it replaces: exporters index one
    // by the other.
    for (asset, state) in scene.assets.iter().zip(&frame.assets) {
        let place = |name: &str| format!("asset {}, {name}, frame {}", asset.id, frame.number);
        check_pose(state, &place("pose"))?;
        for (object, m) in asset.meshes.iter().zip(&state.meshes) {
            match m {
                MeshFrame::Same => {}
                MeshFrame::Points { points, normals, velocities } => {
                    same_length(points.len(), object.mesh.points.len(), &place(&object.name))?;
                    finite(points, &place(&object.name), "point")?;
                    finite(normals, &place(&object.name), "normal")?;
                    finite(velocities, &place(&object.name), "velocity")?;
                }
                // A whole mesh replaces the topology, so that only the mesh itself can be checked.
                MeshFrame::Whole { mesh, velocities } => {
                    check_mesh(mesh, &place(&object.name))?;
                    finite(velocities, &place(&object.name), "velocity")?;
                }
            }
        }
        for (instancer, s) in asset.instancers.iter().zip(&state.instancers) {
            if let InstancerFrame::State(s) = s {
                check_state(instancer, s, &place(&instancer.name))?;
            }
        }
        for (cloud, s) in asset.points.iter().zip(&state.points) {
            if let PointsFrame::State { positions, widths, velocities, colors } = s {
                same_length(positions.len(), cloud.positions.len(), &place(&cloud.name))?;
                finite(positions, &place(&cloud.name), "position")?;
                finite_scalars(widths, &place(&cloud.name), "width")?;
                finite(velocities, &place(&cloud.name), "velocity")?;
                if !colors.is_empty() {
                    same_length(colors.len(), positions.len(), &place(&cloud.name))?;
                }
                finite_scalars(colors.as_flattened(), &place(&cloud.name), "color")?;
            }
        }
        for (curves, s) in asset.curves.iter().zip(&state.curves) {
            if let CurvesFrame::Points(points) = s {
                same_length(points.len(), curves.points.len(), &place(&curves.name))?;
                finite(points, &place(&curves.name), "point")?;
            }
        }
    }
    Ok(())
}

fn check_pose(state: &AssetFrame, place: &str) -> Result<()> {
    match state.pose.iter().position(|j| !(j.t.is_finite() && j.r.is_finite() && j.s.is_finite())) {
        Some(i) => Err(Error::export("X001", format!("{place}: joint {i} is not finite"))),
        None => Ok(()),
    }
}

fn check_mesh(mesh: &Mesh, place: &str) -> Result<()> {
    finite(&mesh.points, place, "point")?;
    finite(&mesh.normals, place, "normal")?;
    same_length(mesh.normals.len(), mesh.points.len(), place)?;
    if !mesh.uvs.is_empty() {
        same_length(mesh.uvs.len(), mesh.points.len(), place)?;
    }
    if let Some(i) = mesh.uvs.iter().position(|v| !v.is_finite()) {
        return Err(Error::export("X001", format!("{place}: uv {i} is not finite")));
    }
    let n = mesh.points.len();
    check_attributes(&mesh.attributes, AttributeDomain::Vertex, n, place)?;
    if let Some(i) = mesh.triangles.iter().position(|t| t.iter().any(|&v| v as usize >= n)) {
        return Err(Error::export("X001", format!("{place}: triangle {i} names a vertex that is not there")));
    }
    let mut next = 0;
    for s in &mesh.subsets {
        if s.first != next {
            return Err(Error::export(
                "X006",
                format!("{place}: a subset starts at face {} instead of {next}", s.first),
            ));
        }
        next += s.count;
    }
    if next as usize != mesh.triangles.len() {
        let faces = mesh.triangles.len();
        return Err(Error::export("X006", format!("{place}: subsets cover {next} of {faces} faces")));
    }
    Ok(())
}

/// Checks the attributes of a geometry that has `count` elements of `domain`: one value per element, or one for the whole.
fn check_attributes(attributes: &[Attribute], domain: AttributeDomain, count: usize, place: &str) -> Result<()> {
    for Attribute { name, domain: own, data } in attributes {
        let due = match own {
            AttributeDomain::Mesh => 1,
            own if *own == domain => count,
            own => {
                return Err(Error::export("X001", format!("{place}: attribute {name} is per {own:?}, not {domain:?}")));
            }
        };
        same_length(data.len(), due, &format!("{place}, {name}"))?;
        if let Some((i, value)) = data.first_invalid() {
            let wanted =
                if matches!(data, AttributeData::F32(_) | AttributeData::Vector(_)) { "finite" } else { "0 to 1" };
            return Err(Error::export("X001", format!("{place}: {name} {i} is {value}, not {wanted}")));
        }
    }
    Ok(())
}

fn check_state(instancer: &Instancer, state: &InstanceState, place: &str) -> Result<()> {
    let n = instancer.len();
    if state.positions.len() != n || state.orientations.len() != n {
        let got = state.positions.len();
        return Err(Error::export("X008", format!("{place}: {got} instances in a clip of {n} slots")));
    }
    finite(&state.positions, place, "position")?;
    finite(&state.velocities, place, "velocity")?;
    finite(&state.angular_velocities, place, "angular velocity")?;
    check_attributes(&state.attributes, AttributeDomain::Instance, n, place)?;
    match state.orientations.iter().position(|q| !q.is_finite() || (q.length() - 1.0).abs() > 1e-4) {
        Some(i) => Err(Error::export("X001", format!("{place}: orientation {i} is not a unit quaternion"))),
        None => Ok(()),
    }
}

fn same_length(got: usize, wanted: usize, place: &str) -> Result<()> {
    if got == wanted {
        Ok(())
    } else {
        Err(Error::export("X001", format!("{place}: {got} values where {wanted} are due")))
    }
}

fn finite(values: &[Vec3], place: &str, what: &str) -> Result<()> {
    match values.iter().position(|v| !v.is_finite()) {
        Some(i) => Err(Error::export("X001", format!("{place}: {what} {i} is not finite"))),
        None => Ok(()),
    }
}

fn finite_scalars(values: &[f32], place: &str, what: &str) -> Result<()> {
    match values.iter().position(|v| !v.is_finite()) {
        Some(i) => Err(Error::export("X001", format!("{place}: {what} {i} is not finite"))),
        None => Ok(()),
    }
}
