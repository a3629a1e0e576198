@@@ driver
#include <stdio.h>
#include "@HEADER@"
#define @UPPER@_FLOAT
#include "@HEADER@"

enum { N = @UPPER@_JOINTS, B = @UPPER@_PARAMETERS, INPUTS = @INPUTS@ };

int main(int count, char **names)
{
    static double in[INPUTS][N], out[4][N], mass[N * N], part[N];
    static float inf_[INPUTS][N], outf_[N];
    FILE *from, *to;
    int i, j, k;
@BEGIN@    if (count != 3 || !(from = fopen(names[1], "rb")) || !(to = fopen(names[2], "wb"))) {
        return 2;
    }
    while (fread(in, sizeof(double), INPUTS * N, from) == INPUTS * N) {
        for (k = 0; k < INPUTS; ++k) {
            for (i = 0; i < N; ++i) {
                inf_[k][i] = (float)in[k][i];
            }
        }
@STEP@        @LOWER@_inverse_dynamics(in[0], in[1], in[2], @TEMP@@MEMORY@out[0]);
        @LOWER@_inverse_dynamicsf(inf_[0], inf_[1], inf_[2], @TEMPF@@MEMORYF@outf_);
        @LOWER@_mass_matrix(in[0], mass);
        @LOWER@_friction(in[0], in[1], in[2], @TEMP@@MEMORY@out[1]);
        @LOWER@_gravity(in[0], part);
        for (i = 0; i < N; ++i) {
            out[1][i] += part[i];
            for (j = 0; j < N; ++j) {
                out[1][i] += mass[N * i + j] * in[2][j];
            }
        }
        @LOWER@_coriolis(in[0], in[1], part);
        for (i = 0; i < N; ++i) {
            out[1][i] += part[i];
            out[2][i] = (double)outf_[i];
        }
@REGRESSOR@
        if (fwrite(out, sizeof(double), 4 * N, to) != 4 * N) {
            return 3;
        }
    }
    fclose(from);
    return fclose(to) ? 4 : 0;
}
@@@ regressor
        {
            static double y[N * B], beta[B];
            @LOWER@_base_parameters(beta);
            @LOWER@_regressor(in[0], in[1], in[2], @TEMP@@MEMORY@y);
            @LOWER@_known_torque(in[2], out[3]);
            for (i = 0; i < N; ++i) {
                for (j = 0; j < B; ++j) {
                    out[3][i] += y[B * i + j] * beta[j];
                }
            }
        }
