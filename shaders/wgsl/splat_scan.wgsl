// Prefix sums within a workgroup of 256 invocations.

var<workgroup> scan_sums: array<u32, WORKGROUP>;

/// The sum of `value` over the invocations before `lane` (Hillis and Steele, "Data Parallel Algorithms", 1986).
/// All invocations of the workgroup must call it.
fn sum_before(lane: u32, value: u32) -> u32 {
    scan_sums[lane] = value;
    workgroupBarrier();
    for (var step = 1u; step < WORKGROUP; step *= 2u) {
        var sum = scan_sums[lane];
        if lane >= step {
            sum += scan_sums[lane - step];
        }
        // All lanes have read before any of them writes.
        workgroupBarrier();
        scan_sums[lane] = sum;
        workgroupBarrier();
    }
    // The sums include `value` itself.
    return scan_sums[lane] - value;
}
