"""Names of the conditions of an assessment, as the report and its charts show them."""

CONDITIONS = {
    "slack": "slack cord",
    "rigid": "rigid cuffs",
    "shift": "with migration",
    "visco_elastic": "with compliance",
    "both": "with migration and compliance",
}
LIMIT = "rigid cuffs (theoretical limit)"
