#include "codec/ply_columns.hpp"

#include "base/first_touch.hpp"
#include "cloud/attribute_name.hpp"
#include "cloud/box_of_most.hpp"
#include "cloud/georeference.hpp"
#include "codec/normal_scale.hpp"

#include <algorithm>
#include <array>
#include <iterator>
#include <utility>

namespace stipple {

namespace {

constexpr unsigned kAlpha = 3;  // of the components of a colour

AttributeValues values_of(PlyType type, std::size_t count) {
    return with_type(type, [&]<typename T>() {
        std::vector<Kept<T>> values;
        resize_in_huge_pages(values, count);
        return AttributeValues(std::move(values));
    });
}

}  // namespace

PlyDestination::PlyDestination(const PlyLayout& layout, std::optional<Vec3d> origin)
    : layout_(layout), wide_(layout.wide_coordinates()), origin_(origin) {
    allocate();
    std::size_t offset = 0;
    std::size_t attribute = 0;
    for (std::size_t i = 0; i < layout.roles.size(); ++i) {
        const PlyProperty& property = layout.vertex->properties[i];
        columns.push_back({&property, offset, sink_for(layout.roles[i], property, attribute)});
        offset += size_of(property.type);
    }
}

PointCloud PlyDestination::finish(DecodeReport& report) {
    if (wide_ && !origin_) place_coordinates();
    if (!wide_colors_.values.empty() && !wide_colors_.narrow(cloud_.colors, alpha_apart_))
        report.skipped.emplace_back(WideColors<std::uint16_t>::kLost);
    if (!float_colors_.values.empty() && !float_colors_.narrow(cloud_.colors, alpha_apart_))
        report.skipped.emplace_back(WideColors<float>::kLost);
    cloud_.origin = origin_.value_or(Vec3d::Zero());
    cloud_.double_precision = wide_;
    for (Attribute& attribute : cloud_.attributes)
        attribute.reduction = reduction_of(attribute.name, attribute.values);
    for (const auto& [property, any] : roundings_)
        if (any) report.skipped.push_back(digits_lost_of(property->name));
    for (auto& [property, sink] : lists_) keep_or_report(*property, sink, report);
    if (layout_.has(PlyRole::Normal)) scale_normals();
    std::ranges::move(settle_names(cloud_), std::back_inserter(report.skipped));
    return std::move(cloud_);
}

void PlyDestination::allocate() {
    const auto n = static_cast<std::size_t>(layout_.vertex->count);
    resize_in_huge_pages(cloud_.positions, n);
    if (wide_ && !origin_) resize_in_huge_pages(coordinates_, n);
    if (layout_.has(PlyRole::Normal)) resize_in_huge_pages(cloud_.normals, n);
    if (layout_.has(PlyRole::Color)) resize_in_huge_pages(cloud_.colors, n);
    constexpr std::array kWide = {PlyType::Int16,  PlyType::UInt16, PlyType::Int32,
                                  PlyType::UInt32, PlyType::Int64,  PlyType::UInt64};
    constexpr std::array kFloating = {PlyType::Float32, PlyType::Float64};
    cloud_.has_alpha = layout_.has(PlyRole::Color, kAlpha);
    keep_colors(kWide, wide_colors_);
    keep_colors(kFloating, float_colors_);
    for (std::size_t i = 0; i < layout_.roles.size(); ++i) {
        const PlyProperty& property = layout_.vertex->properties[i];
        if (layout_.roles[i].kind != PlyRole::Attribute || property.is_list()) continue;
        AttributeValues values = values_of(property.type, n);
        cloud_.attributes.push_back({property.name, std::move(values)});
    }
}

bool PlyDestination::colors_are(std::span<const PlyType> types) const {
    bool any = false;
    for (std::size_t i = 0; i < layout_.roles.size(); ++i) {
        const PlyRole& role = layout_.roles[i];
        if (role.kind != PlyRole::Color || role.component == kAlpha) continue;
        if (std::ranges::find(types, layout_.vertex->properties[i].type) == types.end())
            return false;
        any = true;
    }
    return any;
}

/// Room for them, if they are of one of these types.
void PlyDestination::keep_colors(std::span<const PlyType> types, auto& colors) {
    if (!colors_are(types)) return;
    colors.resize(static_cast<std::size_t>(layout_.vertex->count));
    for (std::size_t i = 0; i < layout_.roles.size(); ++i) {
        const PlyRole& role = layout_.roles[i];
        if (role.kind == PlyRole::Color && role.component == kAlpha)
            alpha_apart_ =
                std::ranges::find(types, layout_.vertex->properties[i].type) == types.end();
    }
}

PlySink PlyDestination::sink_for(const PlyRole& role, const PlyProperty& property,
                                 std::size_t& attribute) {
    constexpr std::array kChannels = {&Rgba8::r, &Rgba8::g, &Rgba8::b, &Rgba8::a};
    switch (role.kind) {
        case PlyRole::Position:
            if (!wide_) return VectorSink{cloud_.positions.data(), role.component};
            if (!origin_) return CoordinateSink{coordinates_.data(), role.component};
            return GeoreferencedSink{cloud_.positions.data(), role.component,
                                     (*origin_)[role.component]};
        case PlyRole::Normal:
            return VectorSink{cloud_.normals.data(), role.component};
        case PlyRole::Color:
            if (role.component == kAlpha && alpha_apart_)
                return ColorSink{cloud_.colors.data(), &Rgba8::a};
            if (!wide_colors_.values.empty())
                return WideColorSink<std::uint16_t>{wide_colors_.values.data(), role.component};
            if (!float_colors_.values.empty())
                return WideColorSink<float>{float_colors_.values.data(), role.component};
            return ColorSink{cloud_.colors.data(), kChannels[role.component]};
        case PlyRole::Attribute:
            break;
    }
    if (!property.is_list()) {
        roundings_.emplace_back(&property, false);
        return AttributeSink{&cloud_.attributes[attribute++].values, &roundings_.back().second};
    }
    lists_.emplace_back(&property, ListSink{values_of(property.type, 0), {}});
    return &lists_.back().second;
}

/// Integers that stand for -1..1.
void PlyDestination::scale_normals() {
    for (std::size_t i = 0; i < layout_.roles.size(); ++i) {
        const PlyRole& role = layout_.roles[i];
        if (role.kind != PlyRole::Normal) continue;
        const float scale = with_type(layout_.vertex->properties[i].type, normal_scale);
        if (scale == 1) continue;
        for (Vec3f& normal : cloud_.normals) normal[role.component] *= scale;
    }
}

void PlyDestination::place_coordinates() {
    Aabb box;
    for (const Vec3d& p : coordinates_) {
        if (!p.allFinite()) continue;
        box.min = box.min.cwiseMin(p);
        box.max = box.max.cwiseMax(p);
    }
    origin_ = choose_origin(
        box, some_of(coordinates_.size(), [&](std::size_t i) { return coordinates_[i]; }));
    for (std::size_t i = 0; i < coordinates_.size(); ++i) {
        cloud_.positions[i] = (coordinates_[i] - *origin_).cast<float>();
    }
    coordinates_ = {};
}

void PlyDestination::keep_or_report(const PlyProperty& property, ListSink& list,
                                    DecodeReport& report) {
    if (!list.uniform || list.length.value_or(0) == 0) {
        report.skipped.push_back("vertex." + property.name);
        return;
    }
    if (list.rounded) report.skipped.push_back(digits_lost_of(property.name));
    const Reduction reduction = reduction_of(property.name, list.values);
    cloud_.attributes.push_back(
        {property.name, std::move(list.values), static_cast<unsigned>(*list.length), reduction});
}

}  // namespace stipple
