/* Texts of status and health codes. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/health.h"
#include "dse/status.h"

static const char *text_of_status(int code)
{
    return dse_status_text((enum dse_status)code);
}

static const char *text_of_health(int code)
{
    return dse_health_text((enum dse_health)code);
}

/* All codes from first to last have a line of their own; codes outside have the text `unknown`. */
static void check_texts(const char *(*text)(int), int first, int last, const char *unknown)
{
    for (int code = first; code <= last; code++) {
        assert_non_null(text(code));
        assert_true(strlen(text(code)) > 0);
        assert_null(strchr(text(code), '\n'));
        assert_string_not_equal(text(code), unknown);
        for (int other = first; other < code; other++)
            assert_string_not_equal(text(code), text(other));
    }
    assert_string_equal(text(first - 1), unknown);
    assert_string_equal(text(last + 1), unknown);
}

static void every_status_has_its_own_line(void **state)
{
    (void)state;
    check_texts(text_of_status, DSE_EINFEASIBLE, DSE_OK, "unknown status");
    assert_string_equal(dse_status_text(DSE_OK), "ok");
}

static void every_health_has_its_own_name(void **state)
{
    (void)state;
    check_texts(text_of_health, DSE_HEALTH_INITIALISING, DSE_HEALTH_ALONE, "unknown health");
    assert_string_equal(dse_health_text(DSE_HEALTH_TRACKING), "tracking");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_status_has_its_own_line),
        cmocka_unit_test(every_health_has_its_own_name),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
