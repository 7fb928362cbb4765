"""The cut: servo, arm and toolpath, and the path error for assumed K and D."""
