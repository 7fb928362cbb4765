"""The cut: servo, arm and toolpath, and the path error that parameters are worth."""
