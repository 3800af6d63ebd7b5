#include "rendering/camera.hpp"

#include "base/refuse.hpp"
#include "cloud/point_bounds.hpp"

#include <algorithm>
#include <cmath>

namespace stipple {

namespace {

Camera axes(const ViewOptions& view) {
    Camera camera;
    camera.forward = -view.toward_eye.normalized();
    camera.right = camera.forward.cross(view.up).normalized();
    camera.up = camera.right.cross(camera.forward);
    camera.perspective = view.field_of_view_rad > 0;
    return camera;
}

void check(const ViewOptions& view) {
    const double cross = view.toward_eye.cross(view.up).norm();
    if (!(cross > 1e-6 * view.toward_eye.norm() * view.up.norm()))
        refuse("up: expected a direction other than toward_eye, both nonzero");
    require(view.field_of_view_rad >= 0 && view.field_of_view_rad <= 2.5, "field_of_view_rad",
            view.field_of_view_rad, "0..2.5");
    require(view.margin >= 0 && view.margin <= 0.45, "margin", view.margin, "0..0.45");
}

}  // namespace

Eigen::AlignedBox2d picture_bounds(std::span<const Vec3f> points, const Camera& camera,
                                   const RunContext& context) {
    return bounds_of(points, context, [&](const Vec3f& p) -> Eigen::Vector2d {
        const Vec3d q = seen(camera, p.cast<double>());
        return q.head<2>() / (camera.perspective ? q.z() : 1.0);
    });
}

Camera fit_camera(std::span<const Vec3f> points, const ViewOptions& view, double aspect,
                  const RunContext& context) {
    if (points.empty()) refuse("points: none to look at");
    require(aspect > 0 && std::isfinite(aspect), "aspect", aspect, "more than 0");
    check(view);
    Camera camera = axes(view);
    const auto box =
        bounds_of(points, context, [](const Vec3f& p) -> Vec3d { return p.cast<double>(); });
    const double size = std::max(box.diagonal().norm(), 1e-30);
    const double fill = 1 - 2 * view.margin;
    camera.half_height = camera.perspective ? std::tan(0.5 * view.field_of_view_rad) : 1;
    const double fov_scale = camera.perspective ? fill * camera.half_height : 1;
    camera.eye = box.center() - size / fov_scale * camera.forward;
    // Moves sideways until the picture is in the middle and, in perspective, along the axis until
    // it fills the frame: each step nearly undoes what the other left.
    for (int i = 0; i < 8; ++i) {
        const Eigen::AlignedBox2d picture = picture_bounds(points, camera, context);
        const double depth =
            camera.perspective ? (box.center() - camera.eye).dot(camera.forward) : 1;
        camera.eye +=
            depth * (picture.center().x() * camera.right + picture.center().y() * camera.up);
        if (!camera.perspective) continue;
        const auto spare = bounds_of(points, context, [&](const Vec3f& p) {
            const Vec3d q = seen(camera, p.cast<double>());
            const double need = std::max(std::abs(q.x()) / aspect, std::abs(q.y())) / fov_scale;
            return Eigen::Matrix<double, 1, 1>(q.z() - need);
        });
        camera.eye += spare.min().x() * camera.forward;
    }
    const Eigen::Vector2d half = 0.5 * picture_bounds(points, camera, context).sizes();
    if (!camera.perspective)
        camera.half_height = std::max({half.x() / aspect, half.y(), 1e-30}) / fill;
    return camera;
}

}  // namespace stipple
