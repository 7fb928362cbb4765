"""What README's performance table is made from: jointid against what a user would pick instead."""
