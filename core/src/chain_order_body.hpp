// Compiled for several instruction sets by chain_order.cpp; see kernel_sets.hpp.

/// The slot whose point is nearest to `from`, by the sum of the differences of its coordinates; the
/// first of several.
int nearest_slot(const Window& window, const int from[3]) noexcept {
    int least = kNone;
    for (int slot = 0; slot < kSlots; ++slot) {
        const int dx = window.x[slot] - from[0];
        const int dy = window.y[slot] - from[1];
        const int dz = window.z[slot] - from[2];
        const int distance = (dx < 0 ? -dx : dx) + (dy < 0 ? -dy : dy) + (dz < 0 ? -dz : dz);
        const int key = kSlots * distance + slot;
        least = key < least ? key : least;
    }
    return least % kSlots;
}
